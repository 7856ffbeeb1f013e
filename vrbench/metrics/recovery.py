"""Recovery: how long after a loss of tracking the pose is right again, and how far it is off."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Ints, Transform
from vrbench.metrics.compared import MM, fit_poses, under
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent, summarise
from vrbench.streams import Event
from vrbench.trajectory import NS

UNITS = {"recovery.time": "s", "recovery.found": "s", "recovery.offset": "mm"}
SHOWN = ("rmse", "mean", "median", "max")
MIN_LOSS_S = 0.1
# The frame from before a loss: long enough that noise averages out of it, short against drift.
BEFORE_S, BESIDE_S = 2.0, 0.5
# Headsets err by 1-2 mm, and were off by 20-50 mm in the published recordings where they jumped:
# what is between tells the two apart.
RECOVERED_M = 0.005
# An error that only passes through on its way stays below for less. A test shows that neither the
# two seconds, nor the 5 mm, nor this matters: at twice and at half of each the times are the same.
HELD_S = 0.25


def losses(good_t: Ints) -> list[tuple[int, int]]:
    """Last stamp before and first stamp after each loss: no good sample for `MIN_LOSS_S`."""
    at = np.flatnonzero(np.diff(good_t) > MIN_LOSS_S * NS)
    return [(int(good_t[i]), int(good_t[i + 1])) for i in at]


def recovery(
    t: Ints, truth: Transform, estimate: Transform, lost: int, back: int, until: int
) -> tuple[float | None, float | None]:
    """Time [s] and offset [m] of one loss, in the frame fitted on the two seconds before it.

    The offset is the length of the mean error in the half second after. The time runs from the loss
    until the error has come within 5 mm, and stays there for a quarter of a second.

    Args:
        t: stamps (n,) [ns], increasing.
        truth: `T_base_eye` (n,).
        estimate: `T_world_eye` (n,), in any world.
        lost: the last good stamp before [ns].
        back: the first good stamp after [ns].
        until: the next loss, or the end [ns].

    Returns:
        None for the time where it never recovers; None for both without samples beside the loss.
    """
    before = (t <= lost) & (t >= lost - BEFORE_S * NS)
    after = (t >= back) & (t <= until)
    if not before.any() or not after.any():
        return None, None
    y = fit_poses(truth[before], estimate[before])
    t, error = t[after], (y @ estimate[after]).p - truth[after].p
    beside = t <= t[0] + BESIDE_S * NS
    offset = float(np.linalg.norm(error[beside].mean(axis=0)))
    off = np.flatnonzero(np.linalg.norm(error, axis=1) > RECOVERED_M)
    # It may have recovered at the first sample, or after each that is off; it holds until the next.
    starts = np.concatenate(([0], off + 1))
    ends = np.concatenate((off, [len(t) - 1]))
    for start, end in zip(starts, ends, strict=True):
        if start <= end and t[end] - t[start] >= HELD_S * NS:
            return float(t[start] - lost) / NS, offset
    return None, offset


def of_take(take: ScoredTake) -> Iterator[Value]:
    """Times and offsets over all losses; the longest time is unknown if one never recovers.

    In takes in which hands covered cameras only the losses that they made count: others come by
    chance, are short, and would make a headset that has many of them look good. Times run from the
    uncovering, otherwise from the loss. `found` is until there are poses again, `time` until they
    are right.
    """
    try:
        times, found, offsets = _all(take)
    except EstimationError as error:
        for name, unit in UNITS.items():
            yield absent(name, unit, str(error), statistic="max", point="eye")
        return
    never = sum(time is None for time in times)
    if never:
        reason = f"{never} of {len(times)} losses never recovered to {MM * RECOVERED_M:g} mm"
        yield absent("recovery.time", "s", reason, statistic="max", point="eye")
    else:
        seconds = np.array(times, dtype=np.float64)
        yield from summarise("recovery.time", seconds, "s", point="eye", only=SHOWN)
    yield from summarise("recovery.found", np.array(found), "s", point="eye", only=SHOWN)
    yield from summarise("recovery.offset", MM * np.array(offsets), "mm", point="eye", only=SHOWN)


def _all(take: ScoredTake) -> tuple[list[float | None], list[float], list[float]]:
    """Times to be right (None: never) and to be found [s], and offsets [m], of each loss."""
    good_t = np.unique(take.samples.pose_t[take.samples.good])
    every = losses(good_t)
    if not every:
        raise EstimationError("tracking was never lost")
    hidden = coverings(take.events())
    found = of_coverings(every, hidden) if hidden else [(*loss, loss[0]) for loss in every]
    if not found:
        raise EstimationError("tracking wasn't lost while cameras were covered")
    eye = next(under(take, Transform.identity()))
    times: list[float | None] = []
    blind: list[float] = []
    offsets: list[float] = []
    for lost, back, since in found:
        until = min((t for t, _ in every if t >= back), default=int(good_t[-1]))
        time, offset = recovery(take.estimate.t, eye.truth, eye.estimate, lost, back, until)
        if offset is not None:
            after = (since - lost) / NS
            times.append(None if time is None else max(0.0, time - after))
            blind.append(max(0.0, (back - since) / NS))
            offsets.append(offset)
    if not offsets:
        raise EstimationError("there is no reference beside the losses of tracking")
    return times, blind, offsets


def coverings(events: Iterable[Event]) -> list[tuple[int, int]]:
    """From when to when hands had more cameras covered than after it [ns], each within a take."""
    steps = sorted((e for e in events if e.kind == "occlusion"), key=lambda e: e.t)
    return [(a.t, b.t) for a, b in pairwise(steps) if _covers(a) > _covers(b)]


def _covers(event: Event) -> tuple[bool, int]:
    """How much an event covers, for comparing: a model's cameras may not be known."""
    return event.detail.get("level") == "all", len(event.detail.get("cameras", ()))


def of_coverings(
    every: Sequence[tuple[int, int]], hidden: Sequence[tuple[int, int]]
) -> list[tuple[int, int, int]]:
    """The losses that coverings made: from the last good stamp before to the first good one after.

    A headset goes on for a moment by what else it feels, and may find itself again before somebody
    has said that it is uncovered; what it finds while it is covered it loses again.

    Returns:
        last stamp before and first stamp after each, and when it was uncovered [ns].
    """
    found = []
    for covered, uncovered in hidden:
        within = [(lost, back) for lost, back in every if lost < uncovered and back > covered]
        if within:
            found.append((within[0][0], within[-1][1], uncovered))
    return found


FAMILY = Family(
    name="recovery",
    title="How long after a loss of tracking the pose is right again, and how far off it is",
    units=UNITS,
    of_take=of_take,
    needs=frozenset({"x"}),
)
