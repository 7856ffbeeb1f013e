"""How sure a number over several takes is, by nothing but how the takes scatter."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from vrbench.geometry import Floats
from vrbench.statistics.bootstrap import (
    LEVEL,
    Interval,
    Statistic,
    draw_members,
    expanded_percentiles,
    independent_members,
    nested,
    scope_of,
)

REPLICATES = 500


def drawn_takes(places: Sequence[tuple[Hashable, Hashable]], rng: np.random.Generator) -> Floats:
    """How often each take is in each replicate (500, n): sittings, mounts and takes are drawn.

    Args:
        places: sitting and mount of each take (n).
        rng: where the randomness comes from.
    """
    groups, n = nested(places), len(places)
    drawn = [np.bincount(draw_members(groups, rng), minlength=n) for _ in range(REPLICATES)]
    return np.array(drawn, dtype=np.float64)


def interval_of_takes(
    values: Floats,
    samples: Floats,
    drawn: Floats,
    places: Sequence[tuple[Hashable, Hashable]],
    statistic: Statistic,
) -> Interval:
    """The expanded percentile interval of the rmse or mean over all samples of the takes.

    A take is drawn whole: what happens in it once, or depends on how it began, is one chance.

    Args:
        values: the rmse or mean of each take (n,).
        samples: on how many samples each rests (n,).
        drawn: how often each take is in each replicate, of `drawn_takes`.
        places: sitting and mount of each take (n).
        statistic: `rmse` or `mean`.
    """
    weights = drawn * samples
    powers = values**2 if statistic == "rmse" else values
    found = weights @ powers / weights.sum(axis=1)
    if statistic == "rmse":
        found = np.sqrt(found)
    members = independent_members(places, len(places))
    return Interval(*expanded_percentiles(found, LEVEL, members), scope_of(places))
