"""Jitter: how much the headset's pose trembles while the reference rests."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.metrics.compared import MM
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.rest import deviations, rest_slots, slot_of, turns_within
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent, summarise

UNITS = {"jitter.position": "mm", "jitter.rotation": "deg"}
SHOWN = ("rmse", "median", "p95", "max")


def of_take(take: ScoredTake) -> Iterator[Value]:
    """Deviations of the eye from its mean over each second of rest."""
    chosen = rest_slots(take.reference)
    start = int(take.reference.t[0]) if len(take.reference) else 0
    still = np.isin(slot_of(take.estimate.t, start), chosen)
    if not still.any():
        reason = "the reference is never at rest for a whole second"
        yield from (absent(name, unit, reason) for name, unit in UNITS.items())
        return
    estimate = take.estimate[still]
    slot = slot_of(estimate.t, start)
    position = deviations(estimate.pose.p - estimate.pose.p[0], slot)
    rotation = deviations(turns_within(estimate.pose.q, slot), slot)
    for name, error in (
        ("jitter.position", MM * position),
        ("jitter.rotation", np.degrees(rotation)),
    ):
        distance = np.linalg.norm(error, axis=1)
        yield from summarise(name, distance, UNITS[name], point="eye", only=SHOWN)


FAMILY = Family(
    name="jitter",
    title="How much the pose trembles at rest",
    units=UNITS,
    of_take=of_take,
)
