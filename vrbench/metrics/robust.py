"""Slopes that a few bad samples do not move."""

from __future__ import annotations

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats

GROUPS = 300


def theil_sen(x: Floats, y: Floats) -> float:
    """The median of the slopes between all pairs of points (Theil, 1950; Sen, 1968).

    More than `GROUPS` points are first reduced to the medians of that many groups of neighbours in
    x, so that the work stays in proportion to the number of points.

    Args:
        x: where (n,).
        y: what (n,).

    Raises:
        EstimationError: x doesn't take two different values.
    """
    if len(x) > GROUPS:
        order = np.argsort(x, kind="stable")
        x, y = _medians(x[order]), _medians(y[order])
    first, second = np.triu_indices(len(x), k=1)
    run = x[second] - x[first]
    keep = run != 0.0
    if not keep.any():
        raise EstimationError("a slope needs samples at two different places")
    return float(np.median((y[second] - y[first])[keep] / run[keep]))


def _medians(values: Floats) -> Floats:
    """Medians of `GROUPS` groups of neighbours, the first of them one longer if need be."""
    size, longer = divmod(len(values), GROUPS)
    split = longer * (size + 1)
    return np.concatenate(
        (
            np.median(values[:split].reshape(longer, size + 1), axis=1),
            np.median(values[split:].reshape(GROUPS - longer, size), axis=1),
        )
    )


def slope_interval(x: Floats, y: Floats, level: float) -> tuple[float, float] | None:
    """The interval of `theil_sen`'s slope by Kendall's statistic (Sen, 1968); at most 300 points.

    It holds for errors that are independent of each other, whatever their distribution. None where
    there are too few points for the level.

    Args:
        x: where (n,), all different.
        y: what (n,).
        level: probability that the interval is to hold.
    """
    from scipy.special import ndtri

    n = len(x)
    first, second = np.triu_indices(n, k=1)
    slopes = np.sort((y[second] - y[first]) / (x[second] - x[first]))
    # the standard deviation of Kendall's S without ties
    reach = float(ndtri((1 + level) / 2)) * np.sqrt(n * (n - 1) * (2 * n + 5) / 18)
    low, high = int((len(slopes) - reach) // 2), int((len(slopes) + reach) // 2 + 1)
    if low < 0 or high >= len(slopes):
        return None
    return float(slopes[low]), float(slopes[high])
