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
from vrbench.statistics.uncertainty import (
    ErrorModel,
    Key,
    motion_part,
    quadratic_models,
    time_bins,
)
from vrbench.trajectory import NS

# Pairs share what lies between their poses; blocks have to be as long, and there have to be some.
LEAST_BLOCKS = 8


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
        found = quadratic_models(take, vectors, bins)
        for point, truth, estimate in take.points():
            key = f"{T}@{delta:g}s", point
            error, _ = rpe_poses(truth, estimate, pairs)
            arm = (truth[pairs[0]].inverse() @ truth[pairs[1]]).p
            found[key] = replace(found[key], motion=motion_part(arm, error, bins))
        models |= {key: replace(model, centred=True, slow=False) for key, model in found.items()}
    return models


def relative_vectors(take: ScoredTake, pairs: Pairs, delta: float) -> Iterator[tuple[Key, Floats]]:
    """Error vectors (k, 3) of pairs that are `delta` [s] apart, by metric and point."""
    for point, truth, estimate in take.points():
        translation, turn = rpe_poses(truth, estimate, pairs)
        yield (f"{T}@{delta:g}s", point), MM * translation
        yield (f"{R}@{delta:g}s", point), np.degrees(quat_to_rotvec(turn))
