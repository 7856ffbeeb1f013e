"""Poses that tell nothing of the motion: repeated ones, and those that jump away and back."""

from __future__ import annotations

import numpy as np

from vrbench.geometry import Bools, Floats, quat_normalize, relative_angle
from vrbench.trajectory import NS, Trajectory

# A runtime that has lost its place may tell the last pose again and again; noise never does.
LONGEST_REPEAT_S = 0.1
# Poses to each side whose median a pose is held against.
NEIGHBOURS = 3
# Standard deviations, of a normal distribution with the same median, that are noise still.
CUT = 6.0
# What a turn that isn't even may add: a part of what the fastest one covers in the window.
UNEVEN = 0.1


def informative(estimate: Trajectory, fastest_rad_s: float) -> Bools:
    """Which poses (n,) of a headset a clock may be found by.

    Left out are those that repeat one pose for more than 0.1 s, and those that lie away from the
    median of seven, by more than noise and the reference's fastest turn explain (Hampel's filter).

    Args:
        estimate: the eye's poses.
        fastest_rad_s: the largest angular speed of the reference [rad/s].
    """
    moving = ~_repeated(estimate)
    keep = moving.copy()
    keep[moving] = ~_away(estimate[moving], fastest_rad_s)
    return keep


def _repeated(estimate: Trajectory) -> Bools:
    """Which poses (n,) lie within a stretch of equal ones, but for its first."""
    n = len(estimate)
    same = np.zeros(n, dtype=bool)
    if n > 1:
        pose = np.hstack((estimate.pose.p, estimate.pose.q))
        same[1:] = np.all(pose[1:] == pose[:-1], axis=1)
    starts = np.flatnonzero(~same)
    ends = np.append(starts[1:], n) - 1
    long = (estimate.t[ends] - estimate.t[starts]) > LONGEST_REPEAT_S * NS
    return same & np.repeat(long, ends - starts + 1)


def _away(estimate: Trajectory, fastest_rad_s: float) -> Bools:
    """Which rotations (n,) lie away from the median of their neighbours and themselves."""
    n, size = len(estimate), 2 * NEIGHBOURS + 1
    if n < size:
        return np.zeros(n, dtype=bool)
    windows = np.lib.stride_tricks.sliding_window_view(estimate.pose.q, size, axis=0)
    middle: Floats = quat_normalize(np.partition(windows, NEIGHBOURS, axis=2)[:, :, NEIGHBOURS])
    angle = relative_angle(estimate.pose.q[NEIGHBOURS : n - NEIGHBOURS], middle)
    noise = CUT * 1.4826 * float(np.median(angle))
    turn = UNEVEN * fastest_rad_s * estimate.period_s * (size - 1)
    away = np.zeros(n, dtype=bool)
    away[NEIGHBOURS : n - NEIGHBOURS] = angle > noise + turn
    return away
