"""Stretches of a take that its events declare: loops, gaps between them, rests, the opening."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from vrbench.geometry import Bools, Ints
from vrbench.metrics.scored import ScoredTake
from vrbench.streams import Columns, Samples
from vrbench.trajectory import NS

# Arrival a second off the stamp is no delay: the stamps are of another clock.
OTHER_CLOCK_NS = NS


def spans(columns: Columns, kind: str, reference: Samples) -> Ints:
    """Starts and ends (k, 2) [ns] of the stretches of a kind, on the reference's clock.

    A stretch that never ended, as in a take that was cut short, isn't one.

    Args:
        columns: the take.
        kind: `loop`, `gap`, `hold` or `opening`.
        reference: the stream whose clock it is.
    """
    found, start = [], None
    for event in columns.events:
        if event.kind == kind and event.detail.get("at") == "start":
            start = event.t
        elif event.kind == kind and start is not None:
            found.append((start, event.t))
            start = None
    return np.array(found, dtype=np.int64).reshape(-1, 2) + recorder_behind_ns(reference)


def recorder_behind_ns(reference: Samples) -> int:
    """What the recorder's clock, that of events, lacks of a stream's [ns]; 0 where they are one."""
    late = int(np.median(reference.pose_t - reference.receive_t)) if len(reference) else 0
    return late if abs(late) > OTHER_CLOCK_NS else 0


def inside(t: Ints, of: Ints) -> Bools:
    """Which times (n,) [ns] lie in one of the spans (k, 2), in order and apart."""
    if not len(of):
        return np.zeros(len(t), dtype=bool)
    index = np.searchsorted(of[:, 0], t, side="right") - 1
    within: Bools = (index >= 0) & (t < of[np.maximum(index, 0), 1])
    return within


def without(take: ScoredTake, left_out: Iterable[Ints]) -> ScoredTake:
    """The take without the poses of its estimate in these spans; its window and samples stay."""
    keep = np.ones(len(take.estimate), dtype=bool)
    for of in left_out:
        keep &= ~inside(take.estimate.t, of)
    if keep.all():
        return take
    return replace(take, estimate=take.estimate[keep], truth=take.truth[keep])
