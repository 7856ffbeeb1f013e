"""Relative pose error: how far a motion over a given time is from what it was."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.metrics.compared import MM, NO_X
from vrbench.metrics.pairs import RPE_S, R, T, pairs_of
from vrbench.metrics.pose_errors import rpe
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent, summarise


def of_take(take: ScoredTake) -> Iterator[Value]:
    """RPE over `RPE_S`, of all pairs of samples that far apart to half a period."""
    for delta in RPE_S:
        names = (f"{T}@{delta:g}s", "mm"), (f"{R}@{delta:g}s", "deg")
        if take.x is None:
            yield from (absent(name, unit, NO_X) for name, unit in names)
            continue
        pairs = pairs_of(take, delta)
        if len(pairs[0]) == 0:
            reason = f"no two samples are {delta:g} s apart"
            yield from (absent(name, unit, reason) for name, unit in names)
            continue
        for point, truth, estimate in take.points():
            translation, rotation = rpe(truth, estimate, pairs)
            (t_name, _), (r_name, _) = names
            yield from summarise(t_name, MM * translation, "mm", point=point)
            yield from summarise(r_name, np.degrees(rotation), "deg", point=point)


FAMILY = Family(
    name="rpe",
    title="Relative pose error: how far a motion over a given time is from what it was",
    units={f"{m}@{d:g}s": u for m, u in ((T, "mm"), (R, "deg")) for d in RPE_S},
    of_take=of_take,
    needs=frozenset({"x"}),
)
