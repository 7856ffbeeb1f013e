"""Tilt: by how much the headset's sense of up changes, within a take and between takes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Transform, quat_conjugate, quat_multiply, quat_rotate
from vrbench.metrics.compared import NO_X, WORLD_UP
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent, summarise
from vrbench.trajectory import NS

END_S = 5.0


def up_in_base(truth: Transform, estimate: Transform) -> Floats:
    """The world's up (n, 3) in base, as each single pose has it: unit vectors.

    `T_base_world = T_base_eye T_world_eye^-1`, and a runtime's world has y up.

    Args:
        truth: `T_base_eye` (n,).
        estimate: `T_world_eye` (n,).
    """
    world = quat_multiply(truth.q, quat_conjugate(estimate.q))
    return quat_rotate(world, np.broadcast_to(WORLD_UP, (len(world), 3)))


def angles_between(a: Floats, b: Floats) -> Floats:
    """Angles [rad] in 0..pi between vectors (..., 3), exact for small ones too."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))


def of_take(take: ScoredTake) -> Iterator[Value]:
    """Angles of up to its mean over the take, and from the first to the last five seconds."""
    try:
        up = _up(take)
    except EstimationError as error:
        yield absent("tilt", "deg", str(error), statistic="last-first")
        return
    spread = np.degrees(angles_between(up, up.mean(axis=0)))
    yield from summarise("tilt", spread, "deg", only=("rmse", "median", "p95", "max"))
    since = (take.estimate.t - take.estimate.t[0]) / NS
    first, last = since <= END_S, since >= since[-1] - END_S
    if since[-1] < 2 * END_S:
        reason = f"the take lasts {since[-1]:.3g} s, less than {2 * END_S:g} s"
        yield absent("tilt", "deg", reason, statistic="last-first")
        return
    change = angles_between(up[first].mean(axis=0), up[last].mean(axis=0))
    n = int(np.count_nonzero(first | last))
    yield Value("tilt", "last-first", float(np.degrees(change)), "deg", n)


def of_repeats(takes: Sequence[ScoredTake]) -> Iterator[Value]:
    """Angles of each take's mean up to the first take's."""
    try:
        if len(takes) < 2:
            raise EstimationError("there is one repeat only")
        means = np.array([_up(take).mean(axis=0) for take in takes])
    except EstimationError as error:
        yield absent("tilt", "deg", str(error), statistic="max")
    else:
        change = np.degrees(angles_between(means[1:], means[0]))
        yield from summarise("tilt", change, "deg", only=("rmse", "max"))


def _up(take: ScoredTake) -> Floats:
    if take.x is None:
        raise EstimationError(NO_X)
    if len(take.estimate) == 0:
        raise EstimationError("no samples in the window")
    return up_in_base(take.truth @ take.x, take.estimate.pose)


FAMILY = Family(
    name="tilt",
    title="By how much the headset's sense of up changes",
    units={"tilt": "deg"},
    of_take=of_take,
    needs=frozenset({"x"}),
    of_repeats=of_repeats,
)
