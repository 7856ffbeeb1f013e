"""Opens a rig: its devices, connected, on one clock."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vrbench.config.case import UNCOVERED
from vrbench.config.rig import SIMULATED, DeviceChoice, Rig
from vrbench.config.suite import Suite
from vrbench.devices.host import RealClock
from vrbench.devices.ports import PoseSource, Robot, Session
from vrbench.devices.simulated.robot import START_EYE
from vrbench.devices.simulated.stage import Stage, VirtualClock
from vrbench.devices.specs import HeadsetProfile
from vrbench.errors import ConfigError
from vrbench.geometry import Transform
from vrbench.plugin.manager import Plugins, check_options, pick
from vrbench.results.record import AccuracyRecord, OcclusionRecord
from vrbench.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class ChosenDevice:
    """A device that a rig names.

    Attributes:
        kind: `headset`, `mocap` or `robot`.
        spec: its plugin's.
        options: the rig's, as the plugin's own model; files among them found beside the rig.
    """

    kind: str
    spec: Any
    options: Any


@dataclass(frozen=True, slots=True)
class ChosenDevices:
    """All that a rig names.

    Attributes:
        profile: of the headset that is ranked.
        headset: the route by which its poses come.
    """

    profile: HeadsetProfile
    headset: ChosenDevice
    mocap: ChosenDevice | None = None
    robot: ChosenDevice | None = None

    def __iter__(self) -> Iterator[ChosenDevice]:
        return (d for d in (self.headset, self.mocap, self.robot) if d is not None)


@dataclass(frozen=True, slots=True)
class Devices:
    """A rig's devices, connected.

    Attributes:
        session: what they were opened with; it has a stage where they are simulated.
        profile: of the headset that is ranked.
    """

    session: Session
    profile: HeadsetProfile
    headset: PoseSource
    robot: Robot | None = None
    mocap: PoseSource | None = None

    @property
    def sources(self) -> dict[str, PoseSource]:
        """All that send poses, the headset last: references stand ready when it starts."""
        found = {"robot": self.robot, "mocap": self.mocap, "headset": self.headset}
        return {name: source for name, source in found.items() if source is not None}


def is_simulated(rig: Rig, rig_name: str) -> bool:
    """Whether all of a rig is simulated, in virtual time.

    Raises:
        ConfigError: a part of it is: what is simulated rides on a simulated stage only.
    """
    choices = {"headset": rig.headset, "robot": rig.robot, "mocap": rig.mocap}
    kinds = {name: c.plugin == SIMULATED for name, c in choices.items() if c is not None}
    if len(set(kinds.values())) > 1:
        odd = next(name for name, simulated in kinds.items() if simulated)
        raise ConfigError(
            "is simulated, and other devices of the rig are not",
            file=rig_name,
            field=odd,
            fix="simulated devices ride on a simulated robot, all or none",
        )
    return next(iter(kinds.values()))


def headset_profile(rig: Rig, rig_name: str, plugins: Plugins) -> HeadsetProfile:
    """What is known of the model that is ranked.

    Raises:
        ConfigError: no such model, or it is a route to headsets.
    """
    spec = pick(
        plugins.headsets, rig.headset.model, "headset", field="headset.device", file=rig_name
    )
    if spec.profile is None:
        raise ConfigError(
            f"{spec.name} is a route to headsets, not a headset model",
            file=rig_name,
            field="headset.device",
            fix="name the model that is benchmarked",
        )
    return spec.profile


def chosen_devices(rig: Rig, rig_name: str, plugins: Plugins) -> ChosenDevices:
    """A rig's devices, their options validated; none of them is touched.

    Raises:
        ConfigError: a device isn't there, has no live connection, or an option is wrong.
    """
    profile = headset_profile(rig, rig_name, plugins)
    headset = chosen_device("headset", rig.headset, rig_name, plugins)
    if headset.spec.open is None:
        raise ConfigError(
            f"{headset.spec.name} has no live connection",
            file=rig_name,
            field="headset.plugin",
            fix="name a route, or import its recordings",
        )
    mocap = robot = None
    if rig.mocap is not None:
        mocap = chosen_device("mocap", rig.mocap, rig_name, plugins)
    if rig.robot is not None:
        robot = chosen_device("robot", rig.robot, rig_name, plugins)
    return ChosenDevices(profile, headset, mocap, robot)


def chosen_device(
    kind: str, choice: DeviceChoice, rig_name: str | None, plugins: Plugins
) -> ChosenDevice:
    """One device, its options validated.

    Args:
        kind: `headset`, `mocap` or `robot`.
        choice: the rig's.
        rig_name: the rig's path or name; None where no rig names the device.
        plugins: that have it.

    Raises:
        ConfigError: the device isn't there, or an option is wrong.
    """
    spec = pick(plugins.things(kind), choice.plugin, kind, field=f"{kind}.plugin", file=rig_name)
    options = check_options(
        choice.options,
        spec.options,
        field=f"{kind}.options",
        file=rig_name,
        beside=choice.beside_options,
    )
    beside = Path(rig_name).parent if rig_name else Path()
    files = {name: beside / value for name, value in options if isinstance(value, Path)}
    return ChosenDevice(kind, spec, options.model_copy(update=files))


def open_rig(rig: Rig, rig_name: str, plugins: Plugins, seed: int, stack: ExitStack) -> Devices:
    """All devices of a rig; `stack` releases them.

    Args:
        rig: whose devices.
        rig_name: its path or name, for messages.
        plugins: that have them.
        seed: of everything random, where they are simulated.
        stack: that they are entered on.

    Raises:
        ConfigError: a device isn't there, or an option is wrong.
        DeviceError: a device doesn't answer.
    """
    # All options are checked before the first device is touched.
    chosen = chosen_devices(rig, rig_name, plugins)
    session = _session(rig, seed, simulated=is_simulated(rig, rig_name))
    robot = mocap = None
    if chosen.robot is not None:
        arm = chosen.robot
        robot = stack.enter_context(arm.spec.open(arm.options, session))
    if chosen.mocap is not None:
        system = chosen.mocap
        mocap = stack.enter_context(system.spec.open(system.options, session))
    route = chosen.headset
    headset = stack.enter_context(route.spec.open(route.options, chosen.profile, session))
    return Devices(session, chosen.profile, headset, robot, mocap)


def nominal_rates(rig: Rig, rig_name: str, plugins: Plugins) -> dict[str, float]:
    """How often each of a rig's devices is to send [Hz], by `robot`, `mocap`, `headset`.

    Raises:
        ConfigError: as `chosen_devices`.
    """
    chosen = chosen_devices(rig, rig_name, plugins)
    rates = {"headset": chosen.profile.rate_hz}
    for device in (chosen.robot, chosen.mocap):
        if device is not None:
            rates[device.kind] = device.spec.rate_hz
    return rates


def occlusion_of(suite: Suite, rig: Rig, rig_name: str, plugins: Plugins) -> OcclusionRecord | None:
    """What the suite's levels of occlusion cover on this headset; None where it covers nothing."""
    levels = {case.occlude for case in suite.all_cases()} - {UNCOVERED}
    if not levels:
        return None
    profile = headset_profile(rig, rig_name, plugins)
    covered = {level: profile.covered(level) for level in sorted(levels)}
    return OcclusionRecord(
        cameras=dict(profile.cameras),
        levels={level: sorted(o.cameras) for level, o in covered.items() if o is not None},
    )


def accuracy_of(rig: Rig) -> dict[str, AccuracyRecord]:
    """What the rig states of its references."""
    stated = {"robot": rig.robot, "mocap": rig.mocap}
    return {
        name: AccuracyRecord(metres=device.accuracy.value, source=device.accuracy.source)
        for name, device in stated.items()
        if device is not None and device.accuracy is not None
    }


def _session(rig: Rig, seed: int, *, simulated: bool) -> Session:
    mounting = rig.mounting.tcp_eye.transform()
    if not simulated:
        return Session(RealClock(), mounting, seed)
    stage, host = Stage(), VirtualClock()
    # The hand, or the flange, is somewhere before anything moves it.
    rest = START_EYE @ mounting.inverse()
    stage.move(Trajectory(np.array([host.now()]), Transform(rest.p[None], rest.q[None])))
    return Session(host, mounting, seed, stage)
