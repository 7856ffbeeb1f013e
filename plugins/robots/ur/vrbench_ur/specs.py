"""The arms as vrbench sees them; nothing heavy is imported before a hook's thing is used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any

from vrbench.devices.ports import Finding, MotionPlanner, Robot, Session
from vrbench.devices.rehearsal import Rehearsal
from vrbench.devices.specs import RobotSpec
from vrbench.errors import ConfigError
from vrbench.geometry import Transform
from vrbench_ur.arms import ARMS, UR5E, Arm
from vrbench_ur.options import Options


@contextmanager
def _installed() -> Iterator[None]:
    """Where a library has no wheel for this system, that is what is said."""
    try:
        yield
    except ImportError as error:
        raise ConfigError(
            f"{error.name} is not installed: there is no wheel of it for this system",
            field="robot.plugin",
            fix="plan on Linux or macOS, move the robot from Linux",
        ) from None


def _open(arm: Arm, options: Options, session: Session) -> Robot:
    with _installed():
        from vrbench_ur.robot import UrRobot

    return UrRobot(arm, options, session)


def _planner(arm: Arm, options: Options, mounting: Transform) -> MotionPlanner:
    with _installed():
        from vrbench_ur.planning import PlannerPort

    return PlannerPort(arm, options, mounting)


def _check(arm: Arm, options: Options, _session: Session) -> Iterator[Finding]:
    from vrbench_ur.probe import findings

    return findings(arm, options)


def _where(options: Options) -> str:
    return options.host


@contextmanager
def _stand_in(arm: Arm, _rehearsal: Rehearsal) -> Iterator[Mapping[str, Any]]:
    """The emulated arm, which moves as it is told to."""
    from vrbench_ur.testing import STARTS, Emulator, options

    with Emulator("--model", arm.name) as emulator:
        # nothing stands around an emulated arm, and a small one comes near a table on its way
        around = {"table_m": None}
        chosen = options(emulator.host, start=STARTS[arm.name], workspace=around)
        yield chosen.model_dump(mode="json")


ROBOTS = [
    RobotSpec(
        name=arm.name,
        title=f"{arm.title}, planned and replayed over RTDE",
        open=partial(_open, arm),
        rate_hz=500.0,
        options=Options,
        check=partial(_check, arm),
        emulator=f"vrbench_ur.emulator{'' if arm is UR5E else '.' + arm.name}",
        stand_in=partial(_stand_in, arm),
        planner=partial(_planner, arm),
        real=True,
        where=_where,
    )
    for arm in ARMS.values()
]
