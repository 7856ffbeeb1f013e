"""Coverage: for how much of the window the headset gave a pose that counts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.geometry import Floats, Ints
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent
from vrbench.trajectory import LATE_PERIODS, distinct

# Samples to each side by which a long interval is told from jitter: they tell when the others were
# due.
NEIGHBOURS = 10


def covered_ns(good_t: Ints, start: int, end: int, period_ns: float) -> float:
    """How much of the time from start to end [ns] good samples stand for.

    Each stands for the interval to the next, or for one period where samples are missing between.
    They are where the interval is long, and those around it are as late as it makes them. (Where
    stamps jitter by a third of a period and single samples are missing, these count up to twice.)

    Args:
        good_t: stamps (n,) [ns], increasing, within start and end.
        period_ns: the usual interval [ns].
    """
    intervals = np.diff(np.concatenate(([start], good_t, [end]))).astype(np.float64)
    late = intervals > LATE_PERIODS * period_ns
    inner = np.flatnonzero(late[1:-1])
    late[1 + inner] = _shifts(good_t, inner, period_ns) > LATE_PERIODS * period_ns
    # The window's edges aren't samples: what is missing there is missing wholly.
    credit = np.full(len(intervals), period_ns)
    credit[0] = credit[-1] = 0.0
    return float(np.sum(np.where(late, credit, intervals)))


def _shifts(t: Ints, before: Ints, period_ns: float) -> Floats:
    """By how much (k,) [ns] the samples after some of them are later than those up to these.

    One period where none is missing between, two where one is; each side by the median of what
    its samples t (n,) say, `before` (k,) being the last ones of the earlier side.
    """
    back = np.arange(NEIGHBOURS)
    sides = []
    for sign, first in ((-1, before), (1, before + 1)):
        rows = first[:, None] + sign * back
        inside = (rows >= 0) & (rows < len(t))
        told = (t[np.clip(rows, 0, len(t) - 1)] - t[before][:, None]) - sign * back * period_ns
        sides.append(np.nanmedian(np.where(inside, told, np.nan), axis=1))
    shifts: Floats = sides[1] - sides[0]
    return shifts


def of_take(take: ScoredTake) -> Iterator[Value]:
    """Time covered by good samples and how far the last comes, in % of the window; epochs."""
    names = "coverage.valid", "coverage.completion"
    if len(take.reference) < 2:
        yield from (
            absent(name, "%", "the reference has no window", statistic="value") for name in names
        )
        return
    start, end = int(take.reference.t[0]), int(take.reference.t[-1])
    t = distinct(take.samples.pose_t)
    good = distinct(take.samples.pose_t[take.samples.good])
    good = good[(good >= start) & (good <= end)]
    period = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    covered = covered_ns(good, start, end, period) if len(good) else 0.0
    reached = float(good[-1] - start) if len(good) else 0.0
    if len(good) and end - good[-1] <= LATE_PERIODS * period:
        reached = float(end - start)
    for name, part in zip(names, (covered, reached), strict=True):
        yield Value(name, "value", 100.0 * part / (end - start), "%", len(take.samples))
    epochs = len(take.samples.epochs)
    yield Value("coverage.epochs", "count", float(epochs), "count", len(take.samples))


FAMILY = Family(
    name="coverage",
    title="For how much of the window the headset gave a pose that counts",
    units={"coverage.valid": "%", "coverage.completion": "%", "coverage.epochs": "count"},
    of_take=of_take,
)
