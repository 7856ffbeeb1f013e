"""Rigs: which devices, where; the lab's own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, FiniteFloat

from vrbench.config.quantity import Length
from vrbench.config.strict import Strict
from vrbench.config.yaml_file import load_model, load_yaml
from vrbench.errors import ConfigError
from vrbench.geometry import Transform

SIMULATED = "sim"
FIRST_SIMULATED = "quest-2"
SHARED = ("tcp", "payload", "workspace")


def _unit(q: tuple[float, ...]) -> tuple[float, ...]:
    length = float(np.linalg.norm(q))
    if abs(length - 1.0) > 1e-2:
        raise ValueError(f"a unit quaternion x, y, z, w; this one has length {length:.4g}")
    return q


class Pose(Strict):
    """A rigid transform as people write it.

    Attributes:
        p_m: position x, y, z [m].
        q_xyzw: unit quaternion x, y, z, w.
    """

    p_m: tuple[FiniteFloat, FiniteFloat, FiniteFloat]
    q_xyzw: Annotated[
        tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat], AfterValidator(_unit)
    ]

    def transform(self) -> Transform:
        return Transform.of(self.p_m, self.q_xyzw)


class Accuracy(Strict):
    """How accurate a reference is over the box it moves in, and who says so.

    Attributes:
        value: its error: 0.1 mm.
        source: who says so: a certificate, a data sheet, a measurement.
    """

    value: Annotated[Length, Field(gt=0.0)]
    source: str = Field(min_length=1)


class DeviceChoice(Strict):
    """A plugin's device and its options, which the plugin itself validates.

    Attributes:
        plugin: the name of the device, as `vrbench plugin list` has it.
        options: what the plugin asks for: addresses, axes, names.
    """

    plugin: str
    options: dict[str, Any] = Field(default_factory=dict)

    @property
    def beside_options(self) -> tuple[str, ...]:
        """Options that the rig's file has beside `options`, not among them."""
        return ()


class ReferenceChoice(DeviceChoice):
    """A device that counts as truth.

    Attributes:
        accuracy: how accurate it is, and who says so; the noise floor rests on it.
    """

    accuracy: Accuracy | None = None


class RobotChoice(ReferenceChoice):
    """A robot; what it carries and what stands around it are options that every robot has.

    Attributes:
        tcp: the tool's centre from the flange, as the plugin's own options say.
        payload: what the flange carries, as the plugin's own options say.
        workspace: what stands around it, or a YAML file that says so, beside the rig.
    """

    tcp: list[Any] | None = Field(None, exclude=True)
    payload: dict[str, Any] | None = Field(None, exclude=True)
    workspace: dict[str, Any] | str | None = Field(None, exclude=True)

    @property
    def beside_options(self) -> tuple[str, ...]:
        return tuple(name for name in SHARED if getattr(self, name) is not None)

    def gathered(self, rig: Path) -> RobotChoice:
        """The same with all of them among its options too, a workspace's file read.

        Raises:
            ConfigError: one is given twice, or the file can't be read.
        """
        options = dict(self.options)
        for name in self.beside_options:
            if name in options:
                raise ConfigError(
                    "is given twice", file=rig, field=f"robot.{name}", fix="here or in the options"
                )
            options[name] = getattr(self, name)
        if isinstance(options.get("workspace"), str):
            options["workspace"] = load_yaml(rig.parent / options["workspace"])[0]
        return self.model_copy(update={"options": options})


class HeadsetChoice(DeviceChoice):
    """The route by which poses come, and the model that is ranked.

    Attributes:
        device: the model that is ranked; the plugin's own name where not given.
        firmware: of the headset; results are compared by it.
    """

    device: str | None = None
    firmware: str = "unknown"

    @property
    def model(self) -> str:
        """The name of the ranked model."""
        return self.device or self.plugin


class Mounting(Strict):
    """Nominal mounting: plans use it; scoring uses what calibration measures.

    Attributes:
        tcp_eye: the headset's centre-eye point seen from the robot's tcp.
    """

    tcp_eye: Pose = Pose(p_m=(0.003, 0.087, 0.276), q_xyzw=(0.70710678, 0.0, 0.0, 0.70710678))


class Rig(Strict):
    """A lab's devices.

    Attributes:
        lab: its name, as leaderboards print it.
        headset: what is benchmarked, and how its poses come.
        robot: what moves it, and counts as truth.
        mocap: motion capture that counts as truth.
        mounting: how the headset sits on the robot, nominally.
        environment: what else may matter, light say; kept with the run.
    """

    lab: str = Field(min_length=1)
    headset: HeadsetChoice
    robot: RobotChoice | None = None
    mocap: ReferenceChoice | None = None
    mounting: Mounting = Mounting()
    environment: dict[str, Any] = Field(default_factory=dict)

    @property
    def things(self) -> list[tuple[str, str]]:
        """Kind and name of all that plugins bring to it, model and route of the headset apart."""
        headset = self.headset
        named = [("headset", headset.model), ("headset", headset.plugin)]
        named += [("robot", self.robot.plugin)] if self.robot else []
        named += [("mocap", self.mocap.plugin)] if self.mocap else []
        return list(dict.fromkeys(named))


# The white noise of its simulated encoders is all that it is off by.
SIMULATED_ACCURACY = Accuracy(value=1e-5, source="simulated")


def load_rig(name: str) -> Rig:
    """A rig file by its path, or a simulated rig: `sim`, `sim:quest-pro`.

    Raises:
        ConfigError: no such file, or the file is wrong.
    """
    kind, _, device = name.partition(":")
    if kind == SIMULATED:
        return Rig(
            lab="simulated",
            headset=HeadsetChoice(plugin=SIMULATED, device=device or FIRST_SIMULATED),
            robot=RobotChoice(plugin=SIMULATED, accuracy=SIMULATED_ACCURACY),
        )
    if not Path(name).is_file():
        raise ConfigError(
            "no such rig file", file=name, fix="a path to a .yaml file, or sim:DEVICE"
        )
    rig = load_model(Path(name), Rig)
    if rig.robot is None:
        return rig
    return rig.model_copy(update={"robot": rig.robot.gathered(Path(name))})
