"""Timing: how often and how evenly the headset's samples come."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent, summarise
from vrbench.trajectory import NS, distinct

UNITS = {"timing.rate": "Hz", "timing.interval": "ms", "timing.duplicates": "count"}
SHOWN = ("mean", "median", "std", "min", "max", "p95")


def of_take(take: ScoredTake) -> Iterator[Value]:
    """Rate and intervals of the different pose times of all samples; duplicates beside them.

    A duplicate repeats the stamp, or to the last bit the pose, of the sample before it.
    """
    samples = take.samples
    t = distinct(samples.pose_t)
    if len(t) < 2:
        reason = f"{len(samples)} samples have no interval"
        yield absent("timing.rate", "Hz", reason, statistic="value")
        yield absent("timing.interval", "ms", reason, statistic="median")
    else:
        steps = np.diff(t)
        rate = NS * len(steps) / float(t[-1] - t[0])
        yield Value("timing.rate", "value", rate, "Hz", len(samples))
        yield from summarise("timing.interval", steps / 1e6, "ms", only=SHOWN)
    p, q = samples.pose.p, samples.pose.q
    repeated = np.all(p[1:] == p[:-1], axis=1) & np.all(q[1:] == q[:-1], axis=1)
    repeated |= samples.pose_t[1:] == samples.pose_t[:-1]
    count = float(np.count_nonzero(repeated))
    yield Value("timing.duplicates", "count", count, "count", len(samples))


FAMILY = Family(
    name="timing",
    title="How often and how evenly samples come",
    units=UNITS,
    of_take=of_take,
)
