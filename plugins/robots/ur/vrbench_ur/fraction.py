"""The fraction of a motion that can be followed, as MoveIt's computeCartesianPath counts it.

Between two waypoints the pose is interpolated in max(floor(dp / step), floor(dtheta / turn)) + 1
steps; each is solved with the last state as seed and must be valid. It knows no speeds.
"""

from __future__ import annotations

import numpy as np

from vrbench.geometry import Floats, Ints, Transform, relative_angle, slerp
from vrbench_ur.arms import POSITION
from vrbench_ur.cell import Cell
from vrbench_ur.inverse import solve

# What the paper's authors ran: every waypoint of 12 Hz, no jump check, interpolated every 30 mm,
# which is a spacing and no tolerance.
EEF_STEP_M = 0.03
# MoveIt derives the step of rotation from that of translation; on a head the lever is about this.
TURN_STEP_RAD = EEF_STEP_M / 0.3
COARSE_HZ = 12.0


def moveit_fraction(waypoints: Transform, start: Floats, cell: Cell) -> float:
    """The fraction 0..1 of the flange's waypoints (n,) that can be followed from `start` (6,).

    Args:
        waypoints: `T_base_flange` (n,); the first is where the arm stands.
        start: its joint angles there.
        cell: the arm and what is around it.
    """
    poses, of = _interpolated(waypoints)
    solutions = solve(poses, cell.arm.dh)  # (m, 8, 6)
    q = _followed(solutions, start)
    valid = np.abs(q).max(axis=1) <= POSITION.max() if len(q) else np.zeros(0, dtype=bool)
    valid &= (np.abs(q) <= POSITION).all(axis=1)
    valid &= ~cell.collides(q)
    done = int(valid.argmin()) if not valid.all() else len(q)
    return _share(done, of, len(waypoints) - 1)


def _interpolated(waypoints: Transform) -> tuple[Transform, Ints]:
    """Poses behind the first waypoint, and the segment (m,) that each is of."""
    a, b = waypoints[:-1], waypoints[1:]
    apart = np.linalg.norm(b.p - a.p, axis=1)
    angle = relative_angle(a.q, b.q)
    steps = np.maximum(apart // EEF_STEP_M, angle // TURN_STEP_RAD).astype(np.int64) + 1
    of = np.repeat(np.arange(len(a)), steps)
    first = np.concatenate(([0], np.cumsum(steps)[:-1]))
    u = (np.arange(len(of)) - first[of] + 1) / steps[of]
    p = a.p[of] + u[:, None] * (b.p - a.p)[of]
    return Transform(p, slerp(a.q[of], b.q[of], u)), of


def _followed(solutions: Floats, start: Floats) -> Floats:
    """The solution nearest to the one before, step by step (k, 6), until there is none."""
    q, last = [], start
    for options in solutions:
        options = options[~np.isnan(options[:, 0])]
        if not len(options):
            break
        near = options + 2 * np.pi * np.round((last - options) / (2 * np.pi))
        last = near[np.argmin(np.abs(near - last).sum(axis=1))]
        q.append(last)
    return np.array(q).reshape(-1, 6)


def _share(done: int, of: Ints, segments: int) -> float:
    """Full segments and the part of the one that broke off, over all."""
    if done >= len(of):
        return 1.0
    segment = int(of[done])
    inside = np.flatnonzero(of == segment)
    return (segment + (done - inside[0]) / len(inside)) / max(segments, 1)
