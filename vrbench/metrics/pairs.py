"""Pairs of poses a given delta apart: in frames, in metres of path, in angle, in time."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Ints, Transform, relative_angle
from vrbench.metrics.association import nearest
from vrbench.metrics.scored import ScoredTake
from vrbench.trajectory import NS

Pairs = tuple[Ints, Ints]

UNITS = ("frames", "m", "rad", "deg")
TOLERANCE = 0.1
# Over which times relative errors are told [s], and what they are called.
RPE_S = (0.1, 1.0, 10.0)
T, R = "rpe.translation", "rpe.rotation"


def find_pairs(
    pose: Transform,
    delta: float,
    unit: str = "frames",
    *,
    all_pairs: bool = False,
    tolerance: float = TOLERANCE,
) -> Pairs:
    """Indices (k,) of the first and of the second poses of all pairs, as evo's RPE chooses them.

    Args:
        pose: the trajectory (n,) the deltas are measured on; evo takes the estimate.
        delta: distance of the pairs, in `unit`.
        unit: `frames`, `m`, `rad` or `deg`.
        all_pairs: one pair from each pose (by angle: all that fit), not only consecutive ones.
        tolerance: how far a pair may be off, as a part of delta; used with `all_pairs` only.

    Raises:
        ValueError: an unknown unit, a delta that isn't positive, frames that aren't whole.
        EstimationError: there is no such pair.
    """
    if unit not in UNITS:
        raise ValueError(f"unknown unit {unit!r}: one of {', '.join(UNITS)}")
    if not delta > 0:
        raise ValueError(f"delta is {delta:g}, it must be positive")
    if unit == "frames":
        if delta != int(delta):
            raise ValueError(f"delta is {delta:g} frames, it must be a whole number")
        first, second = pairs_by_frames(len(pose), int(delta), all_pairs=all_pairs)
    elif unit == "m":
        first, second = pairs_by_path(pose.p, delta, tolerance * delta, all_pairs=all_pairs)
    else:
        angle = math.radians(delta) if unit == "deg" else delta
        first, second = pairs_by_angle(pose.q, angle, tolerance * angle, all_pairs=all_pairs)
    if len(first) == 0:
        raise EstimationError(
            f"no two of {len(pose)} poses are {delta:g} {unit} apart", fix="a smaller delta"
        )
    return first, second


def pairs_by_frames(n: int, delta: int, *, all_pairs: bool = False) -> Pairs:
    """Poses `delta` frames apart: (0, d), (1, d + 1) ..., or end to end (0, d), (d, 2d) ..."""
    first = np.arange(0, max(n - delta, 0), 1 if all_pairs else delta)
    return first, first + delta


def pairs_by_path(p: Floats, delta: float, tolerance: float, *, all_pairs: bool = False) -> Pairs:
    """Poses with `delta` [m] of path between them.

    End to end, a pair closes with the first pose at or beyond delta; with `all_pairs` each pose
    is paired with the one nearest to delta, if it lies within the tolerance [m].

    Args:
        p: positions (n, 3) [m].
    """
    steps = np.linalg.norm(np.diff(p, axis=0), axis=1)
    if not all_pairs:
        return end_to_end(steps, delta)
    n = len(p)
    path = np.concatenate(([0.0], np.cumsum(steps)))
    first = np.arange(max(n - 1, 0))
    beyond = np.searchsorted(path, path[first] + delta, side="left")
    # Before it lies a plateau where the path stood still, whose first pose counts.
    plateau = np.searchsorted(path, path[np.maximum(beyond - 1, 0)], side="left")
    short = np.maximum(plateau, first + 1)
    long = np.clip(beyond, first + 1, n - 1)
    off_short = np.abs(path[short] - path[first] - delta)
    off_long = np.abs(path[long] - path[first] - delta)
    second = np.where(off_short <= off_long, short, long)
    keep = np.minimum(off_short, off_long) <= tolerance
    return first[keep], second[keep]


def pairs_by_angle(q: Floats, delta: float, tolerance: float, *, all_pairs: bool = False) -> Pairs:
    """Poses turned by `delta` [rad] against each other.

    End to end, the turns between neighbours add up and a pair closes at or beyond delta. With
    `all_pairs` every pair whose relative angle lies within the tolerance [rad] is taken, which
    takes time in the square of the number of poses.

    Args:
        q: unit quaternions (n, 4).
    """
    if not all_pairs:
        return end_to_end(relative_angle(q[:-1], q[1:]), delta)
    firsts, seconds = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for i in range(len(q) - 1):
        angle = relative_angle(q[i], q[i + 1 :])
        found = np.flatnonzero((angle >= delta - tolerance) & (angle <= delta + tolerance))
        firsts.append(np.full(len(found), i, dtype=np.int64))
        seconds.append(found + i + 1)
    return np.concatenate(firsts), np.concatenate(seconds)


def pairs_by_time(t: Ints, delta_ns: int, tolerance_ns: int) -> Pairs:
    """From each pose one pair: with the pose whose stamp is nearest to `delta` later.

    Args:
        t: stamps (n,) [ns], increasing.
        delta_ns: distance of the pairs [ns].
        tolerance_ns: how far a pair may be off [ns].
    """
    since = (t - t[0]).astype(np.float64) if len(t) else np.zeros(0)
    first, second = nearest(since + delta_ns, since, tolerance_ns)
    later = second > first
    return first[later], second[later]


def end_to_end(steps: Floats, delta: float) -> Pairs:
    """Poses between which steps (n - 1,) add up to delta or more; each pair starts afresh."""
    # Summed from each start on, not as a difference of sums, which would round otherwise.
    ends, since = [0], 0.0
    for i, step in enumerate(steps.tolist(), start=1):
        since += step
        if since >= delta:
            ends.append(i)
            since = 0.0
    pairs = np.array(list(pairwise(ends)), dtype=np.int64).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def pairs_of(take: ScoredTake, delta_s: float) -> Pairs:
    """Indices (k,) of all pairs of samples that far apart to half a period."""
    tolerance = take.estimate.period_s * NS / 2 if len(take.estimate) > 1 else 0.0
    return pairs_by_time(take.estimate.t, round(delta_s * NS), round(tolerance))
