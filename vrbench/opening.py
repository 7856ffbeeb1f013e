"""Opens a rig: its devices, connected, on one clock."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrbench.config.case import UNCOVERED
from vrbench.config.rig import SIMULATED, DeviceChoice, Rig
from vrbench.config.suite import Suite
from vrbench.devices.host import RealClock
from vrbench.devices.ports import HeadsetProfile, PoseSource, Robot, Session
from vrbench.devices.simulated.robot import START_EYE
from vrbench.devices.simulated.stage import Stage, VirtualClock
from vrbench.errors import ConfigError
from vrbench.geometry import Transform
from vrbench.plugin.manager import Plugins, check_options, pick
from vrbench.results.record import AccuracyRecord, OcclusionRecord
from vrbench.trajectory import Trajectory


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
    profile = headset_profile(rig, rig_name, plugins)
    route = pick(
        plugins.headsets, rig.headset.plugin, "headset", field="headset.plugin", file=rig_name
    )
    if route.open is None:
        raise ConfigError(
            f"{route.name} has no live connection",
            file=rig_name,
            field="headset.plugin",
            fix="name a route, or import its recordings",
        )
    session = _session(rig, seed, simulated=is_simulated(rig, rig_name))
    # All options are checked before the first device is touched.
    headset_options = _options(rig.headset, route, "headset", rig_name)
    robot = mocap = None
    if rig.robot is not None:
        arm = pick(plugins.robots, rig.robot.plugin, "robot", field="robot.plugin", file=rig_name)
        arm_options = _options(rig.robot, arm, "robot", rig_name)
    if rig.mocap is not None:
        system = pick(plugins.mocap, rig.mocap.plugin, "mocap", field="mocap.plugin", file=rig_name)
        system_options = _options(rig.mocap, system, "mocap", rig_name)
    if rig.robot is not None:
        robot = stack.enter_context(arm.open(arm_options, session))
    if rig.mocap is not None:
        mocap = stack.enter_context(system.open(system_options, session))
    headset = stack.enter_context(route.open(headset_options, profile, session))
    return Devices(session, profile, headset, robot, mocap)


def nominal_rates(rig: Rig, rig_name: str, plugins: Plugins) -> dict[str, float]:
    """How often each of a rig's devices is to send [Hz], by `robot`, `mocap`, `headset`.

    Raises:
        ConfigError: a device isn't there.
    """
    rates = {"headset": headset_profile(rig, rig_name, plugins).rate_hz}
    if rig.robot is not None:
        arm = pick(plugins.robots, rig.robot.plugin, "robot", field="robot.plugin", file=rig_name)
        rates["robot"] = arm.rate_hz
    if rig.mocap is not None:
        system = pick(plugins.mocap, rig.mocap.plugin, "mocap", field="mocap.plugin", file=rig_name)
        rates["mocap"] = system.rate_hz
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


def _options(choice: DeviceChoice, spec: Any, kind: str, rig_name: str) -> Any:
    return check_options(choice.options, spec.options, field=f"{kind}.options", file=rig_name)
