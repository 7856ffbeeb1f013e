"""The planner as the port wants it: plans, describes and writes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from vrbench.devices.ports import Plan
from vrbench.geometry import Transform
from vrbench.trajectory import Trajectory
from vrbench_ur.arms import Arm
from vrbench_ur.options import Options
from vrbench_ur.plan import UrPlan
from vrbench_ur.plan_file import describe, write_plan
from vrbench_ur.planner import Planner


class PlannerPort:
    """`vrbench.devices.ports.MotionPlanner` of an arm."""

    def __init__(self, arm: Arm, options: Options, mounting: Transform) -> None:
        self._planner = Planner(arm, options, mounting)

    def plan(self, motion: Trajectory, progress: Callable[[str, float], None]) -> Plan:
        return self._planner.plan(motion, progress)

    def describe(self, plan: Plan) -> Sequence[tuple[str, str]]:
        return describe(own(plan))

    def write(self, plan: Plan, path: Path) -> Sequence[Path]:
        return write_plan(own(plan), path)


def own(plan: Plan) -> UrPlan:
    """The plan as this plugin's own.

    Raises:
        TypeError: another robot's planner made it.
    """
    if not isinstance(plan, UrPlan):
        raise TypeError("a plan of another robot's planner")
    return plan
