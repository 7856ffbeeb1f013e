"""Statistics of an error over a take, and the values that carry them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats
from vrbench.metrics.registry import Value

STATISTICS = ("rmse", "mean", "median", "std", "min", "max", "p95", "sse")


def statistics(error: Floats) -> dict[str, float]:
    """All of `STATISTICS` of an error (n,); `std` is of the population, as evo's.

    `sse`, the sum of squares, is in the square of the error's unit.

    Raises:
        EstimationError: the error has no samples.
    """
    if len(error) == 0:
        raise EstimationError("no samples to take statistics of")
    squares = float(np.dot(error, error))
    median, p95 = np.percentile(error, (50.0, 95.0))
    return {
        "rmse": float(np.sqrt(squares / len(error))),
        "mean": float(np.mean(error)),
        "median": float(median),
        "std": float(np.std(error)),
        "min": float(np.min(error)),
        "max": float(np.max(error)),
        "p95": float(p95),
        "sse": squares,
    }


def summarise(
    metric: str,
    error: Floats,
    unit: str,
    *,
    point: str = "",
    band: str = "all",
    only: tuple[str, ...] = STATISTICS,
) -> Iterator[Value]:
    """The statistics of an error (n,), already in the unit that is printed."""
    found = statistics(error)
    for name in only:
        yield Value(metric, name, found[name], unit, len(error), point=point, band=band)


def absent(
    metric: str,
    unit: str,
    reason: str,
    *,
    statistic: str = "rmse",
    point: str = "",
    band: str = "all",
) -> Value:
    """A value that couldn't be had, and why."""
    return Value(metric, statistic, None, unit, 0, point=point, band=band, reason=reason)
