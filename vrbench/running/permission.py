"""What a run must be allowed before a real robot moves: its plans, their hash, and a person's word.

`plan_suite` plans all motions of a suite without a robot, so that the hash exists before anything
moves. `Permission` keeps it for the run: asked for at the start, and again after every prompt that
sends people to the robot.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from vrbench.config.case import OPENING
from vrbench.config.rig import Rig
from vrbench.config.suite import Suite
from vrbench.devices.permit import Permit, confirm, require, run_hash
from vrbench.devices.ports import MotionPlanner, Plan
from vrbench.errors import ConfigError
from vrbench.motion.motion import at_speed
from vrbench.plugin.manager import Plugins
from vrbench.running.opening import chosen_device, is_simulated

Progress = Callable[[str, float], None]
# Asks a person about these plans of a robot, and grants them.
Ask = Callable[[str, list[str], Permit], None]


@dataclass(frozen=True, slots=True)
class Planned:
    """All plans of a suite on a rig's real robot.

    Attributes:
        robot: what moves: the rig's name of it, and its address where it has one.
        plans: by motion and speed.
        planner: that made them.
    """

    robot: str
    plans: Mapping[tuple[str, float], Plan]
    planner: MotionPlanner

    @property
    def hashes(self) -> list[str]:
        """Of the plans, each once."""
        return sorted({plan.hash for plan in self.plans.values()})

    @property
    def hash(self) -> str:
        """Of all of them: what `--execute` names."""
        return run_hash(self.hashes)


@dataclass(frozen=True, slots=True)
class Permission:
    """A run's leave to move a robot.

    Attributes:
        planned: what is to be carried out.
        ask: asks a person, and grants the plans: `vrbench.devices.permit.confirm`.
    """

    planned: Planned
    ask: Ask

    def again(self, permit: Permit) -> None:
        """Asks, at the start, at `--resume`, and after every prompt that sent people to the robot.

        Raises:
            ConfigError: a person didn't confirm.
        """
        permit.revoke()
        self.ask(self.planned.robot, self.planned.hashes, permit)


def plan_suite(
    suite: Suite, rig: Rig, rig_name: str, plugins: Plugins, progress: Progress
) -> Planned | None:
    """Plans of all motions of a suite; None where the rig's robot isn't a real one.

    Args:
        suite: whose cases are planned, each motion and speed once.
        rig: with the nominal mounting.
        rig_name: the rig's path or name, for messages.
        plugins: for the robot.
        progress: told how it goes on.

    Raises:
        ConfigError: the robot's options are wrong, or another device of its rig is simulated.
        DeviceError: a motion can't be done; says where and why.
    """
    if rig.robot is None or suite.mover != "robot":
        return None
    chosen = chosen_device("robot", rig.robot, rig_name, plugins)
    spec = chosen.spec
    if not spec.real:
        return None
    is_simulated(rig, rig_name)  # before minutes of planning: all of a rig is, or nothing
    if spec.planner is None:
        raise ConfigError(
            f"{spec.name} can't plan without moving", file=rig_name, field="robot.plugin"
        )
    planner = spec.planner(chosen.options, rig.mounting.tcp_eye.transform())
    moves = {(case.motion, case.speed) for case in suite.all_cases()}
    if any(case.looped for case in suite.all_cases()):
        moves.add((OPENING, 1.0))
    wanted = {(suite.motion(key).name, speed): suite.motion(key) for key, speed in sorted(moves)}
    plans = {}
    for index, ((name, speed), moved) in enumerate(wanted.items()):
        motion = at_speed(moved, speed)

        def tell(what: str, done: float, name: str = name, index: int = index) -> None:
            progress(f"{name}: {what}", (index + done) / len(wanted))

        plans[name, speed] = planner.plan(motion, tell)
    where = spec.where(chosen.options) if spec.where else None
    return Planned(f"{spec.name} at {where}" if where else spec.name, plans, planner)


def permission(planned: Planned, execute: str | None, ask: Ask = confirm) -> Permission:
    """Leave to ask for with `ask`, where `--execute` names these plans.

    Raises:
        ConfigError: it names none, which makes this a dry run, or others.
    """
    require(execute, planned.hashes)
    return Permission(planned, ask)
