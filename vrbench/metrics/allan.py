"""Allan deviation: how much the error wanders from one stretch of time to the next."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Ints
from vrbench.metrics.compared import MM, aligned_eye
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent
from vrbench.trajectory import NS

TAUS_S = (0.1, 1.0, 10.0, 100.0)
# Fewer differences than this say little of their own spread.
MIN_DIFFERENCES = 5


def allan_deviation(t: Ints, error: Floats, tau_s: float) -> tuple[float, int]:
    """`sqrt(<|m_k+1 - m_k|^2> / 2)` of the means m over neighbouring stretches (Allan, 1966).

    For vectors the squares of the components add up. A stretch counts if it holds at least half as
    many samples as the fullest.

    Args:
        t: stamps (n,) [ns], increasing.
        error: vectors (n, k).
        tau_s: length of a stretch [s].

    Returns:
        The deviation, in the error's unit, and the number of differences.

    Raises:
        EstimationError: fewer than `MIN_DIFFERENCES` differences.
    """
    stretch = (t - t[0]) // round(tau_s * NS) if len(t) else t
    count = np.bincount(stretch)
    full = count >= 0.5 * np.max(count, initial=1)
    sums = np.stack([np.bincount(stretch, weights=column) for column in error.T], axis=1)
    means = sums / np.maximum(count, 1)[:, None]
    steps = np.diff(means, axis=0)[full[1:] & full[:-1]]
    if len(steps) < MIN_DIFFERENCES:
        raise EstimationError(
            f"{len(steps)} neighbouring stretches of {tau_s:g} s", fix=f"{MIN_DIFFERENCES} needed"
        )
    return float(np.sqrt(np.sum(steps**2) / len(steps) / 2)), len(steps)


def of_take(take: ScoredTake) -> Iterator[Value]:
    """Of the aligned position error of the eye; at rest that is the position itself."""
    for tau in TAUS_S:
        name = f"allan@{tau:g}s"
        try:
            error = MM * aligned_eye(take).translation()
            deviation, _ = allan_deviation(take.estimate.t, error, tau)
        except EstimationError as problem:
            yield absent(name, "mm", str(problem), statistic="value", point="eye")
        else:
            yield Value(name, "value", deviation, "mm", len(error), point="eye")


FAMILY = Family(
    name="allan",
    title="How much the error wanders from one stretch of time to the next",
    units={f"allan@{tau:g}s": "mm" for tau in TAUS_S},
    of_take=of_take,
    needs=frozenset({"x"}),
)
