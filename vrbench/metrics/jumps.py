"""Jumps: steps from one sample to the next that the reference did not make."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Ints
from vrbench.metrics.compared import MM, aligned_eye
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent, summarise
from vrbench.trajectory import MAX_GAP_PERIODS

# Headsets err by 1-2 mm and tremble by less from sample to sample; in the published recordings the
# jumps were of 20-50 mm. A clock 5 ms off makes up 0.4 mm at the hardest acceleration of a head.
JUMP_M = 0.010


def jump_sizes(t: Ints, error: Floats) -> Floats:
    """Sizes (k,) [m] of the steps of the error between neighbouring samples above `JUMP_M`.

    Steps across a gap are not jumps: what is off after a loss of tracking, recovery tells.

    Args:
        t: stamps (n,) [ns], increasing.
        error: error vectors (n, 3) [m].
    """
    steps = np.diff(t)
    if len(steps) == 0:
        return np.zeros(0)
    sizes = np.linalg.norm(np.diff(error, axis=0), axis=1)
    return sizes[(sizes > JUMP_M) & (steps <= MAX_GAP_PERIODS * np.median(steps))]


def of_take(take: ScoredTake) -> Iterator[Value]:
    """How many steps of the eye's error there are, and how large they are."""
    try:
        eye = aligned_eye(take)
    except EstimationError as error:
        yield absent("jumps", "count", str(error), statistic="count")
        yield absent("jumps.size", "mm", str(error), statistic="max")
        return
    sizes = jump_sizes(take.estimate.t, eye.translation())
    yield Value("jumps", "count", float(len(sizes)), "count", len(eye.truth), point="eye")
    if len(sizes):
        shown = ("mean", "max")
        yield from summarise("jumps.size", MM * sizes, "mm", point="eye", only=shown)
    else:
        yield absent("jumps.size", "mm", "there are no jumps", statistic="max", point="eye")


FAMILY = Family(
    name="jumps",
    title="Steps from one sample to the next that the reference did not make",
    units={"jumps": "count", "jumps.size": "mm"},
    of_take=of_take,
    needs=frozenset({"x"}),
)
