"""How sure the scale of a take is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vrbench.estimation.alignment import umeyama_scale
from vrbench.estimation.blocks import block_covariance
from vrbench.geometry import Floats
from vrbench.metrics.compared import MM, aligned
from vrbench.metrics.scored import ScoredTake
from vrbench.statistics import NORMAL_95
from vrbench.statistics.bootstrap import Interval
from vrbench.statistics.following import STEP, Errors
from vrbench.statistics.uncertainty import TRANSLATION, moved_x, time_bins


def scale_intervals(
    take: ScoredTake, translation: Errors, x_covariance: Floats | None
) -> dict[tuple[str, str, str], Interval]:
    """Intervals of `scale` by metric, point and statistic: of the take's blocks, and of X.

    The scale is a least-squares fit with one parameter, so its variance is that of the sums of
    its scores over blocks of time. Errors that follow the motion are no part of it: they add the
    same in every such motion. Noise makes the estimate's motion seem larger than it is, by its
    variance over the motion's: the upper end takes that in.

    Args:
        take: with X.
        translation: its errors, from `translation_errors`.
        x_covariance: of X (6, 6), if it is known.

    Raises:
        EstimationError: the take has no X, or can't be aligned.
    """
    bins = time_bins(take.estimate.t)
    found = {}
    by_x = _derivatives(take) if x_covariance is not None else {}
    for at in aligned(take):
        arm = at.estimate.p - at.estimate.p.mean(axis=0)
        square = float(np.einsum("ni,ni->", arm, arm))
        scale = umeyama_scale(at.truth.p, at.estimate.p)
        key = (TRANSLATION, at.point)
        noise = (translation.here[key] - translation.followed(key)) / MM
        scores = np.bincount(bins, np.einsum("ni,ni->n", arm, noise)).astype(np.float64)[:, None]
        variance, _ = block_covariance(np.array([[1.0 / square]]), scores)
        total = float(variance[0, 0])
        if x_covariance is not None:
            total += float(by_x[at.point] @ x_covariance @ by_x[at.point])
        half = NORMAL_95 * float(np.sqrt(total))
        larger = scale * float(np.einsum("ni,ni->", noise, noise)) / square
        found["scale", at.point, "value"] = Interval(scale - half, scale + larger + half, "take")
    return found


def _derivatives(take: ScoredTake) -> dict[str, Floats]:
    """Of the scale by X (6,), at each point."""
    assert take.x is not None
    here = _scales(take)
    steps = [_scales(replace(take, x=moved_x(take.x, dx))) for dx in STEP * np.eye(6)]
    return {point: np.array([step[point] - here[point] for step in steps]) / STEP for point in here}


def _scales(take: ScoredTake) -> dict[str, float]:
    return {point: umeyama_scale(truth, estimate) for point, truth, estimate in take.positions()}
