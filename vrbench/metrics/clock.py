"""Clock: how the headset's clock stood against the reference's."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.clocks import device_time
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent

UNITS = {
    "clock.offset": "ms",
    "clock.skew": "ppm",
    "clock.residual": "ms",
    "latency.lead": "ms",
}
SOURCE = "headset"


def of_take(take: ScoredTake) -> Iterator[Value]:
    """Apparent offset in the middle of the window, mean skew over it, scatter about the map.

    The apparent offset is the clock's minus the lead of the pose prediction. Where the headset
    answered clock exchanges its poses are stamped on the recorder's clock, so that all that is left
    of the offset is the lead. The skew of a take under ten minutes is that of the calibrations.
    """
    n = len(take.estimate)
    if n < 2:
        for name, unit in UNITS.items():
            yield absent(name, unit, f"{n} samples in the window", statistic="value")
        return
    start, end = (
        device_time(take.clock, int(t)) for t in (take.estimate.t[0], take.estimate.t[-1])
    )
    offsets = take.clock.offset_ns(np.array([start, (start + end) // 2, end]))
    yield Value("clock.offset", "value", float(offsets[1]) / 1e6, "ms", n)
    if SOURCE in take.columns.clocks:
        yield Value("latency.lead", "value", -float(offsets[1]) / 1e6, "ms", n)
    else:
        reason = "the headset's clock was not asked: the lead can't be told from its offset"
        yield absent("latency.lead", "ms", reason, statistic="value")
    if offsets[0] == offsets[2]:
        reason = "the take is too short for a skew, and no calibration tells one"
        yield absent("clock.skew", "ppm", reason, statistic="value")
    else:
        skew = float(offsets[2] - offsets[0]) / (end - start)
        yield Value("clock.skew", "value", 1e6 * skew, "ppm", n)
    residual = None if take.clock_fit is None else take.clock_fit.residual_s
    if residual is None:
        reason = "the scatter of the offset was not measured"
        yield absent("clock.residual", "ms", reason)
    else:
        yield Value("clock.residual", "rmse", 1e3 * residual, "ms", n)


FAMILY = Family(
    name="clock",
    title="How the headset's clock stood against the reference's",
    units=UNITS,
    of_take=of_take,
)
