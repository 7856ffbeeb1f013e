"""Pairs of poses a given delta apart: in frames, in metres of path, in time, end to end."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from vrbench.geometry import Floats, Ints
from vrbench.metrics.association import nearest
from vrbench.metrics.scored import ScoredTake
from vrbench.trajectory import NS

Pairs = tuple[Ints, Ints]

TOLERANCE = 0.1
"""How far off a pair may be, as a part of delta, where each pose is paired."""
# Over which times relative errors are told [s], and what they are called.
RPE_S = (0.1, 1.0, 10.0)
T, R = "rpe.translation", "rpe.rotation"


def pairs_by_frames(n: int, delta: int, *, all_pairs: bool = False) -> Pairs:
    """Poses `delta` frames apart: (0, d), (1, d + 1) ..., or end to end (0, d), (d, 2d) ..."""
    first = np.arange(0, max(n - delta, 0), 1 if all_pairs else delta)
    return first, first + delta


def pairs_by_path(p: Floats, delta: float, tolerance: float) -> Pairs:
    """From each pose one pair: with the pose nearest to `delta` [m] of path later.

    Args:
        p: positions (n, 3) [m].
        delta: distance of the pairs [m].
        tolerance: how far a pair may be off [m].
    """
    steps = np.linalg.norm(np.diff(p, axis=0), axis=1)
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
