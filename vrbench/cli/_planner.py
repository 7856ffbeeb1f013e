"""What the verbs of `vrbench motion` are asked about: a motion, and the robot it is planned for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vrbench.config.rig import DeviceChoice, Mounting, load_rig
from vrbench.devices.ports import MotionPlanner
from vrbench.errors import ConfigError
from vrbench.geometry import Transform
from vrbench.motion.files import has_header, read_motion
from vrbench.motion.generators import generate
from vrbench.motion.motion import Motion, relative_to_first
from vrbench.plugin.manager import Plugins
from vrbench.running.opening import chosen_device
from vrbench.trajectory import read_tum


@dataclass(frozen=True, slots=True)
class Chosen:
    """A robot that motions can be planned for.

    Attributes:
        robot: its name.
        planner: of it.
        mounting: nominal `T_tcp_eye`.
    """

    robot: str
    planner: MotionPlanner
    mounting: Transform


def load_motion(name: str) -> Motion:
    """A generated motion by name, a motion file, or a plain TUM file of `T_world_eye`."""
    path = Path(name)
    if path.is_file() and has_header(path):
        return read_motion(path)
    if path.suffix or path.exists():
        return Motion(path.stem, str(path), relative_to_first(read_tum(path)), str(path))
    return generate(name)


def planner_of(rig: str | None, robot: str | None, stretch: float | None = None) -> Chosen:
    """The planner of a rig's robot, or of a robot by name with the plugin's own defaults."""
    if (rig is None) == (robot is None):
        raise ConfigError("name a rig or a robot", field="--rig", fix="--rig RIG or --robot ur5e")
    mounting = Mounting()
    choice = DeviceChoice(plugin=robot or "")
    if rig is not None:
        loaded = load_rig(rig)
        if loaded.robot is None:
            raise ConfigError("the rig has no robot", file=rig, field="robot")
        choice, mounting = loaded.robot, loaded.mounting
    if stretch is not None:
        choice = choice.model_copy(update={"options": {**choice.options, "stretch": stretch}})
    device = chosen_device("robot", choice, rig, Plugins())
    spec = device.spec
    if spec.planner is None:
        raise ConfigError(
            f"{spec.name} needs no plan file: it does every motion", file=rig, field="robot.plugin"
        )
    nominal = mounting.tcp_eye.transform()
    return Chosen(spec.name, spec.planner(device.options, nominal), nominal)
