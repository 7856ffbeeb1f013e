"""Trimming: from where to where the reference moves."""

from __future__ import annotations

import numpy as np

from vrbench.estimation.checks import require_poses
from vrbench.geometry import Bools, Ints, Transform, mean_rotation, relative_angle
from vrbench.trajectory import NS, Trajectory

REST_RADIUS_M = 1e-3
REST_RADIUS_RAD = np.radians(0.2)
SHORTEST_REST_S = 0.5
RESTING_POSE_S = 0.2


def active_window(reference: Trajectory) -> tuple[int, int]:
    """The span [ns, ns], on the reference's clock, in which the reference moves.

    It starts when the reference first leaves its resting pose (1 mm, 0.2 deg: well above the
    0.1 mm noise of a robot's or a motion-capture system's log, 0.1 s into a robot's start) and
    ends when it last enters the pose in which it comes to rest. An end at which the reference
    rests for less than half a second is not trimmed: a person never rests so, and keeps the whole
    span. The estimate has no say.

    Raises:
        EstimationError: fewer than two poses, or values that are not finite.
    """
    require_poses(reference, "reference", 2)
    start = _leaves_rest(reference.t, reference.pose)
    end = -_leaves_rest(-reference.t[::-1], reference.pose[::-1])
    if start >= end:
        return int(reference.t[0]), int(reference.t[-1])
    return start, end


def _leaves_rest(t: Ints, pose: Transform) -> int:
    """The last time [ns] before `pose`, at rest from the first sample on, leaves its place."""
    away = _away(pose, t - t[0] <= RESTING_POSE_S * NS)
    if not away.any():
        return int(t[-1])
    last_at_rest = max(int(np.argmax(away)) - 1, 0)
    rested_ns = t[last_at_rest] - t[0]
    return int(t[last_at_rest] if rested_ns >= SHORTEST_REST_S * NS else t[0])


def _away(pose: Transform, first: Bools) -> Bools:
    """Which poses (n,) are farther than the rest radius from the mean of the first ones."""
    distance = np.linalg.norm(pose.p - np.median(pose.p[first], axis=0), axis=1)
    angle = relative_angle(mean_rotation(pose.q[first]), pose.q)
    return (distance > REST_RADIUS_M) | (angle > REST_RADIUS_RAD)
