"""How sure relative pose errors are: models of them, for the intervals that APE has too."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from vrbench.geometry import Floats, quat_to_rotvec
from vrbench.metrics.compared import MM
from vrbench.metrics.pairs import RPE_S, Pairs, R, T, pairs_of
from vrbench.metrics.pose_errors import rpe_poses
from vrbench.metrics.scored import ScoredTake
from vrbench.statistics.following import Key, errors_of
from vrbench.statistics.uncertainty import ErrorModel, quadratic_models, time_bins
from vrbench.trajectory import NS

# Pairs share what lies between their poses: there have to be some times that, and blocks as long
# as several, or what they cut apart would be missing.
LEAST_BLOCKS = 8
SPANS = 4


def relative_models(take: ScoredTake) -> dict[Key, ErrorModel]:
    """Models of the relative errors of translation [mm] and rotation [deg], at the eye and the tcp.

    Those over a time of which the take hasn't eight have none. They are of the rmse.

    Returns:
        by metric and point; empty where the take has no X.
    """
    models: dict[Key, ErrorModel] = {}
    for delta in RPE_S:
        pairs = pairs_of(take, delta)
        t = take.estimate.t[pairs[0]]
        if take.x is None or len(t) < 2 or int(t[-1]) - int(t[0]) < LEAST_BLOCKS * delta * NS:
            continue
        bins = time_bins(t)
        vectors = partial(relative_vectors, pairs=pairs, delta=delta)
        # that errors of pairs depend on each other is known, though at most lags it doesn't show
        least = SPANS * int(bins[-1] + 1) * delta * NS / int(t[-1] - t[0])
        for key, model in quadratic_models(take, vectors, errors_of(take, vectors), bins).items():
            block = max(model.block, round(least))
            models[key] = replace(model, block=block, slow=False)
    return models


def relative_vectors(take: ScoredTake, pairs: Pairs, delta: float) -> Iterator[tuple[Key, Floats]]:
    """Error vectors (k, 3) of pairs that are `delta` [s] apart, by metric and point."""
    for point, truth, estimate in take.points():
        translation, turn = rpe_poses(truth, estimate, pairs)
        yield (f"{T}@{delta:g}s", point), MM * translation
        yield (f"{R}@{delta:g}s", point), np.degrees(quat_to_rotvec(turn))
