"""Scores a take loop by loop: whether error, clock and world drift over hours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vrbench.clocks import ClockMap, device_time
from vrbench.errors import EstimationError
from vrbench.estimation.fit import fit
from vrbench.geometry import Floats, Ints, Transform, quat_rotate, quat_to_rotvec
from vrbench.metrics.compared import MM, WORLD_UP
from vrbench.metrics.registry import Value
from vrbench.metrics.robust import slope_interval, theil_sen
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent
from vrbench.protocols.protocol import reference_samples
from vrbench.protocols.stretches import inside, spans
from vrbench.results.tables import Row
from vrbench.scoring.cases import Scored, with_intervals
from vrbench.scoring.family_rows import family_rows
from vrbench.scoring.rules import Rules
from vrbench.statistics import NORMAL_95
from vrbench.statistics.bootstrap import LEVEL
from vrbench.statistics.paired import by_phase, paired_difference
from vrbench.statistics.uncertainty import (
    translation_errors,
    translation_models,
    translation_vectors,
)
from vrbench.streams import Columns
from vrbench.trajectory import NS

# On the reference's clock already: what is left of the offset is fitted.
NO_OFFSET = ClockMap(np.array([0], dtype=np.int64), np.array([0.0]))
# Of a family that gives hundreds of numbers, what is worth having of every loop.
OF_LOOPS = ("ape.translation.aligned", "ape.rotation.aligned")
STATISTICS = ("rmse", "mean", "max")
DRIFTS = {"drift.translation": "mm", "drift.yaw": "deg", "drift.tilt": "deg"}
HOUR_S = 3600.0


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """One run of the motion.

    Attributes:
        number: from 1.
        part: of the take.
        hours: from the first loop's middle to its own [h].
        offset_ms: the clock's offset [ms],
        sigma_ms: and its standard deviation.
        y: `T_base_world` fitted to this loop alone.
    """

    number: int
    part: ScoredTake
    hours: float
    offset_ms: float
    sigma_ms: float
    y: Transform


def loop_rows(rules: Rules, scored: Scored, columns: Columns) -> list[Row]:
    """The rows of a looped take's loops, and what they tell together; none of other takes."""
    whole, take = scored.whole, scored.take
    if whole is None or whole.x is None or not rules.case(take).looped:
        return []
    names = {family.name: family for family in rules.families}
    values: list[Value] = []
    rows: list[Row] = []
    loops = list(_loops(whole, spans(columns, "loop", reference_samples(columns, rules.reference))))
    if "ape" in names:
        for loop in loops:
            found = [
                row
                for row in family_rows(rules, take, names["ape"], loop.part, scored.verdict)
                if row.metric in OF_LOOPS and row.band == "all" and row.statistic in STATISTICS
            ]
            models = translation_models(loop.part, translation_errors(loop.part))
            rows += with_intervals(rules, found, take.name, models, scored.x_covariance)
        values += _growth(rows, loops, rules.rng(take.name, "growth"))
    if "clock" in names:
        values += _offsets(loops)
    if "drift" in names:
        values += _drift(loops, whole)
    return rows + [rules.row(take, value, scored.verdict) for value in values]


def _loops(whole: ScoredTake, of: Ints) -> Iterator[Loop]:
    """Each loop, with clock and world fitted to it alone; loops that can't be are left out."""
    first = 0
    for number, span in enumerate(of, start=1):
        within = inside(whole.estimate.t, span[None])
        part = replace(
            whole,
            reference=whole.reference.between(int(span[0]), int(span[1])),
            samples=whole.samples[inside(whole.samples.pose_t, span[None])],
            estimate=whole.estimate[within],
            truth=whole.truth[within],
            segment=f"loop:{number}",
        )
        assert whole.x is not None
        try:
            best = fit(part.reference, part.estimate, clock=NO_OFFSET, x=whole.x, y=whole.y)
        except EstimationError:
            continue
        middle = int(span[0] + (span[1] - span[0]) // 2)
        first = first or middle
        known = float(whole.clock.offset_ns(device_time(whole.clock, middle)))
        yield Loop(
            number=number,
            part=part,
            hours=(middle - first) / NS / HOUR_S,
            offset_ms=(known + float(best.clock.offset_ns(middle))) / 1e6,
            sigma_ms=best.sigma("offset") * 1e3,
            y=best.y,
        )


def _offsets(loops: Sequence[Loop]) -> Iterator[Value]:
    """The clock's offset in each loop."""
    for loop in loops:
        reach = NORMAL_95 * loop.sigma_ms
        yield Value(
            "clock.offset",
            "value",
            loop.offset_ms,
            "ms",
            len(loop.part.estimate),
            segment=loop.part.segment,
            low=loop.offset_ms - reach,
            high=loop.offset_ms + reach,
        )


def _drift(loops: Sequence[Loop], whole: ScoredTake) -> Iterator[Value]:
    """How the world has moved since the first loop, `Y_k Y_1^-1`, where the motion has its middle.

    Translation and tilt are lengths, yaw is signed, positive about up. For each: its value in every
    loop, the largest, the last loop's, and its slope by Theil and Sen. The slope of a vector is the
    length of its axes' slopes; the interval of that length runs from the point of their box of
    intervals that is nearest to nought to the farthest one.
    """
    if len(loops) < 2:
        reason = f"{len(loops)} loops could be fitted, drift needs two"
        for name, unit in DRIFTS.items():
            yield absent(name, f"{unit}/h", reason, statistic="slope", point="eye")
        return
    assert whole.x is not None
    first, eye = loops[0], whole.truth @ whole.x
    centre, up = eye.p.mean(axis=0), quat_rotate(first.y.q, WORLD_UP)
    back = first.y.inverse()
    moved = [loop.y @ back for loop in loops]
    shift = MM * np.array([d.apply(centre) - centre for d in moved])
    turn = np.degrees(np.array([quat_to_rotvec(d.q) for d in moved]))
    yaw = turn @ up
    tilt = turn - np.outer(yaw, up)
    hours = np.array([loop.hours for loop in loops])
    n = len(whole.estimate)
    parts = (
        (shift, np.linalg.norm(shift, axis=1)),
        (yaw[:, None], yaw),
        (tilt, np.linalg.norm(tilt, axis=1)),
    )
    for (name, unit), (axes, shown) in zip(DRIFTS.items(), parts, strict=True):
        for loop, value in zip(loops, shown.tolist(), strict=True):
            of = loop.part
            yield Value(
                *(name, "value", value, unit, len(of.estimate)), point="eye", segment=of.segment
            )
        slope, low, high = _slope(hours, axes)
        yield Value(name, "slope", slope, f"{unit}/h", n, point="eye", low=low, high=high)
        yield Value(name, "max", float(np.abs(shown).max()), unit, n, point="eye")
        yield Value(name, "last-first", float(shown[-1]), unit, n, point="eye")


def _slope(hours: Floats, axes: Floats) -> tuple[float, float | None, float | None]:
    """The slope of axes (k, d) an hour, and its interval; signed where there is one axis."""
    slopes = np.array([theil_sen(hours, axis) for axis in axes.T])
    level = 1.0 - (1.0 - LEVEL) / len(slopes)
    found = [slope_interval(hours, axis, level) for axis in axes.T]
    ends = np.array([ends for ends in found if ends is not None])
    if len(slopes) == 1:
        return float(slopes[0]), *(ends[0].tolist() if len(ends) else (None, None))
    length = float(np.linalg.norm(slopes))
    if len(ends) < len(slopes):
        return length, None, None
    near = np.clip(0.0, ends[:, 0], ends[:, 1])
    far = np.abs(ends).max(axis=1)
    return length, float(np.linalg.norm(near)), float(np.linalg.norm(far))


def _growth(
    rows: Sequence[Row], loops: Sequence[Loop], rng: np.random.Generator
) -> Iterator[Value]:
    """Whether errors grow: their slope over the loops, and the last loop's less the first's."""
    if len(loops) < 2:
        return
    hours = {loop.part.segment: loop.hours for loop in loops}
    for metric, unit in zip(OF_LOOPS, ("mm", "deg"), strict=True):
        for point in ("eye", "tcp"):
            of = [
                (hours[row.segment], row.value)
                for row in rows
                if (row.metric, row.point, row.statistic) == (metric, point, "rmse")
                and row.value is not None
            ]
            if len(of) < len(loops):
                continue
            x, y = np.array(of).T
            ends = slope_interval(x, y, LEVEL) or (None, None)
            slope, n = theil_sen(x, y), sum(len(loop.part.estimate) for loop in loops)
            yield Value(
                *(metric, "slope", slope, f"{unit}/h", n), point=point, low=ends[0], high=ends[1]
            )
    for point in ("eye", "tcp"):
        yield from _last_first(loops, point, rng)


def _last_first(loops: Sequence[Loop], point: str, rng: np.random.Generator) -> Iterator[Value]:
    """The last loop's rmse of translation less the first's, paired by seconds of the motion.

    Rotation has none: what a loop's alignment turns is the same for all of its seconds, and no
    resampling of them would show it.
    """
    both = []
    for loop in (loops[-1], loops[0]):
        error = dict(translation_vectors(loop.part))[OF_LOOPS[0], point]
        phase = (loop.part.estimate.t - loop.part.reference.t[0]) / NS
        both.append(by_phase(phase, np.linalg.norm(error, axis=1)))
    try:
        found = paired_difference(both[:1], both[1:], rng)
    except EstimationError:
        return
    n = len(loops[0].part.estimate) + len(loops[-1].part.estimate)
    value = Value(OF_LOOPS[0], "last-first", found.value, "mm", n, point=point)
    yield replace(value, low=found.low, high=found.high)
