"""Jumps of the eye's world that last, as a recentre that nobody told of leaves them."""

from __future__ import annotations

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Ints, Transform, quat_normalize, relative_angle
from vrbench.trajectory import NS

# Poses whose median is compared with that of as many after them: outliers don't move it.
WINDOW = 31
# How many samples apart places are looked at.
STRIDE = 5
# What no relocalisation reaches and a recentre does.
JUMP_M, JUMP_RAD = 0.1, float(np.radians(10.0))
# The eye is this far from the tcp at most: by so much more it moves where the tcp turns [m].
LEVER_M = 0.5


def refuse_jump(t: Ints, T_base_tcp: Transform, T_world_eye: Transform) -> None:
    """Raises EstimationError where the eye's poses (n,) jump, stay there, and the tcp's don't.

    Distances and angles between poses are compared, so neither X nor Y needs to be known.

    Args:
        t: stamps (n,) [ns].
        T_base_tcp: where the reference is.
        T_world_eye: where the eye says it is, quaternions of continuous sign.
    """
    starts = np.arange(0, len(t) - 2 * WINDOW + 1, STRIDE)
    if not len(starts):
        return
    moved, turned = _steps(T_world_eye, starts)
    moved_tcp, turned_tcp = _steps(T_base_tcp, starts)
    distance = moved - moved_tcp - LEVER_M * turned_tcp
    angle = np.abs(turned - turned_tcp)
    at = int(np.argmax(np.maximum(distance / JUMP_M, angle / JUMP_RAD)))
    if distance[at] < JUMP_M and angle[at] < JUMP_RAD:
        return
    place = starts[at] + WINDOW
    raise EstimationError(
        f"the headset's world jumps near {(t[place] - t[0]) / NS:.1f} s, by about "
        f"{1e3 * moved[at]:.0f} mm and {np.degrees(turned[at]):.0f} deg: it recentred, and "
        "nothing tells of it",
        fix="record it anew, or let the log tell of recentres",
    )


def _steps(pose: Transform, starts: Ints) -> tuple[Floats, Floats]:
    """Distance [m] and angle [rad] from the median of one window to that of the next (k,)."""
    windows = np.arange(WINDOW)
    before, after = (
        Transform(np.median(pose.p[rows], axis=1), quat_normalize(np.median(pose.q[rows], axis=1)))
        for rows in (starts[:, None] + windows, starts[:, None] + WINDOW + windows)
    )
    return np.linalg.norm(after.p - before.p, axis=1), relative_angle(before.q, after.q)
