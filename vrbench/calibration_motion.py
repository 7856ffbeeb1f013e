"""The calibration motion made for a rig: as wide as its arm can, beyond the motions it is for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vrbench.devices.ports import MotionPlanner, Plan
from vrbench.errors import DeviceError
from vrbench.geometry import Transform
from vrbench.motion.generators import REACH, SATURATE_S, saturating
from vrbench.motion.motion import Motion
from vrbench.protocols.calibration import Excursion, excursion, thinned
from vrbench.trajectory import Trajectory

# The motion's box goes beyond the motions' by this share of theirs.
BEYOND = 1.05
# Sizes that are tried, of the one that is wanted; below the least, X is told too badly by it.
SIZES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3)


@dataclass(frozen=True, slots=True)
class Fitted:
    """A calibration motion that a robot can do.

    Attributes:
        motion: itself.
        size: of what contains all motions, 0..1: 1 where the robot can do that.
        plan: the robot's plan of it.
        beyond: by motion, how far that leaves it, from the same start.
    """

    motion: Motion
    size: float
    plan: Plan
    beyond: Mapping[str, Excursion]


def wanted_reach(motions: Sequence[Trajectory]) -> np.ndarray:
    """Amplitudes (6,) [m, rad] that contain the motions' boxes, and no less than `saturate-1`."""
    widest = [np.abs(motion.pose.p).max(axis=0) for motion in motions]
    reach = REACH.copy()
    reach[:3] = np.max([reach[:3], *(BEYOND * wide for wide in widest)], axis=0)
    return reach


def fit(
    name: str,
    planner: MotionPlanner,
    mounting: Transform,
    motions: Mapping[str, Trajectory],
    progress: Callable[[str, float], None],
) -> Fitted:
    """The widest calibration motion that the planner finds a start for.

    Box and turns shrink together; its times stay, so that a smaller one is slower, and a wider one
    than `saturate-1` is slowed down to its speed.

    Args:
        name: of the new motion.
        planner: of the robot.
        mounting: nominal `T_tcp_eye`.
        motions: `T_eye0_eye` that are to lie within it, by name.
        progress: told what is tried, and the part done.

    Raises:
        DeviceError: the robot can't do even the smallest.
    """
    reach = wanted_reach(list(motions.values()))
    refused: DeviceError | None = None
    for index, size in enumerate(SIZES):
        slower = max(1.0, float((size * reach / REACH).max()))
        title = f"Calibration: all axes, slow, {100 * size:.0f} % of what was wanted"
        motion = saturating(name, title, SATURATE_S, size * reach, slower)

        def tell(what: str, done: float, index: int = index, size: float = size) -> None:
            progress(f"{100 * size:.0f} %: {what}", (index + done) / len(SIZES))

        try:
            plan = planner.plan(motion.trajectory, tell)
        except DeviceError as error:
            refused = error
            continue
        return Fitted(motion, size, plan, _beyond(plan, mounting, motions))
    assert refused is not None
    raise refused


def _beyond(
    plan: Plan, mounting: Transform, motions: Mapping[str, Trajectory]
) -> dict[str, Excursion]:
    """How far each motion leaves the plan's poses when it begins where the plan does."""
    calibrated = thinned(plan.target.pose)
    start = plan.target.pose[0] @ mounting
    return {
        name: excursion(calibrated, start @ motion.pose @ mounting.inverse())
        for name, motion in motions.items()
    }
