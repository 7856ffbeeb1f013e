"""Scores one take against one reference: values, their intervals, and the gate's verdict."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from vrbench.cache.stages import family_code
from vrbench.clocks import Skew
from vrbench.errors import DataError, EstimationError
from vrbench.geometry import Floats, Ints, Transform
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.protocols.calibration import Calibration, Verdict, mean_skew, mean_x
from vrbench.protocols.fixing import Fixing, fixing_at
from vrbench.protocols.protocol import (
    HEADSET,
    headset_samples,
    recorded_span,
    reference_samples,
)
from vrbench.protocols.sitting import in_sitting
from vrbench.protocols.stretches import spans, without
from vrbench.results.record import TakeRecord
from vrbench.results.tables import Member, Row, pool
from vrbench.rules import Rules, verdict_of
from vrbench.statistics.bootstrap import Interval
from vrbench.statistics.floor import floor_values
from vrbench.statistics.of_scale import scale_intervals
from vrbench.statistics.relative import relative_models
from vrbench.statistics.uncertainty import (
    ErrorModel,
    Key,
    error_models,
    intervals,
    offset_interval,
)
from vrbench.streams import Columns


@dataclass(frozen=True, slots=True, eq=False)
class Scored:
    """A take, scored.

    Attributes:
        take: its record.
        rows: its rows.
        verdict: how it counts; `failed` where it could not be scored.
        whole: the take made ready, for what only several takes tell together; None if it failed.
        parts: the same by epoch, `all` where there is one; those that could be made ready.
        models: of its errors, by metric and point; empty where it has no X or several epochs.
        x_covariance: of the X it was scored with.
    """

    take: TakeRecord
    rows: Sequence[Row]
    verdict: Verdict
    whole: ScoredTake | None = None
    parts: Mapping[str, ScoredTake] = field(default_factory=dict)
    models: Mapping[Key, ErrorModel] = field(default_factory=dict)
    x_covariance: Floats | None = None


def score(
    rules: Rules,
    take: TakeRecord,
    columns: Columns,
    calibrations: Mapping[str, Calibration],
    failures: Mapping[str, str],
) -> Scored:
    """The rows of one take.

    Args:
        rules: of the run.
        take: its record.
        columns: its content.
        calibrations: those of its mount that succeeded, by take, checks too; its own is not used
            to score it.
        failures: why the others didn't.
    """
    own = calibrations.get(take.name)
    ready = rules.stages.kept(
        "prepare",
        lambda: _prepared_or_why(rules, take, columns, calibrations),
        *(rules.reference, take.name),
        given=columns,
    )
    if isinstance(ready, str):
        return unscored_take(rules, take, Verdict("failed", ready))
    whole, parts, covariance = ready.whole, ready.parts, ready.x_covariance
    verdict = verdict_of(rules, take, ready.span, whole, ready.fixing, own, failures)
    rows = list(_own_rows(rules, take, whole))
    models: Mapping[Key, ErrorModel] = {}
    for segment, part in parts.items():
        found = list(_pose_rows(rules, take, segment, part, verdict))
        if isinstance(part, ScoredTake) and part.x is not None:
            if covariance is not None:
                of = rules.reference, take.name, segment
                compute = partial(_uncertain, rules, take, part, covariance)
                models, ends = rules.stages.kept("intervals", compute, *of, given=columns)
                found = [with_interval(row, ends) for row in found]
            found += [rules.row(take, value, verdict) for value in _floor(rules, take, part)]
        rows += found
    if len(parts) > 1:
        why: dict[Member, str] = {
            (segment,): part if isinstance(part, str) else "" for segment, part in parts.items()
        }
        rows += pool(rows, ("segment",), why)
        models = {}
    return Scored(take, rows, verdict, whole, ready.ready, models, covariance)


def _prepared_or_why(
    rules: Rules, take: TakeRecord, columns: Columns, calibrations: Mapping[str, Calibration]
) -> Prepared | str:
    try:
        return prepared(rules, take, columns, calibrations)
    except (EstimationError, DataError) as error:
        return str(error)


def _uncertain(
    rules: Rules, take: TakeRecord, part: ScoredTake, covariance: Floats
) -> tuple[dict[Key, ErrorModel], dict[tuple[str, str, str], Interval]]:
    """Models of a part's errors, and the intervals over it alone."""
    asked = {family.name for family in rules.families}
    models = dict(error_models(part))
    if "rpe" in asked:
        models |= relative_models(part)
    found = intervals([models], [covariance], [("", "")], rules.rng(take.name))
    return models, found | (scale_intervals(part, covariance) if "scale" in asked else {})


def _floor(rules: Rules, take: TakeRecord, part: ScoredTake) -> list[Value]:
    """Below what the errors of a part mean nothing."""
    stated = rules.record.accuracy.get(rules.reference)
    metres = stated.metres if stated else None
    return rules.stages.kept(
        "floor",
        lambda: list(floor_values(part, metres, rules.rng("floor"))),
        *(rules.reference, take.name, part.segment),
    )


def unscored_take(rules: Rules, take: TakeRecord, verdict: Verdict) -> Scored:
    """A take without numbers: each of its rows says why."""
    rows = [rules.row(take, value, verdict) for value in absent_values(rules.families)]
    return Scored(take, rows, verdict)


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A take as it is scored.

    Attributes:
        whole: the take as a whole,
        parts: and by epoch, `all` where there is one: ready, or why it isn't.
        x_covariance: of the X it is scored with.
        span: when it was recorded, first and last, by the recorder's clock [ns].
        fixing: what X is taken from.
    """

    whole: ScoredTake
    parts: Mapping[str, ScoredTake | str]
    x_covariance: Floats | None
    span: tuple[int, int]
    fixing: Fixing

    @property
    def ready(self) -> dict[str, ScoredTake]:
        """The parts that could be made ready."""
        return {name: part for name, part in self.parts.items() if isinstance(part, ScoredTake)}


def prepared(
    rules: Rules, take: TakeRecord, columns: Columns, calibrations: Mapping[str, Calibration]
) -> Prepared:
    """A take made ready with what the others of its mount found.

    Raises:
        EstimationError: the streams can't be synchronised.
        DataError: a stream is missing.
    """
    span = recorded_span(columns, rules.reference)
    bracket_m = rules.suite.gate.bracket
    fixing = fixing_at(list(calibrations.values()), rules.checks, span[0], bracket_m)
    fixing = fixing.without(take.name)
    x, covariance = _mounting(rules, columns, fixing.best)
    skew = mean_skew(fixing.best)
    whole, parts = _prepared(rules, take, columns, x, covariance, skew)
    parts = {
        name: in_sitting(part, fixing.best, span[0]) if isinstance(part, ScoredTake) else part
        for name, part in parts.items()
    }
    return Prepared(whole, parts, covariance, span, fixing)


def _mounting(
    rules: Rules, columns: Columns, others: Sequence[Calibration]
) -> tuple[Transform | None, Floats | None]:
    """X and its covariance (6, 6), as far as they are known."""
    if rules.protocol.given_x is not None:
        return rules.protocol.given_x(columns), None
    return mean_x(others) if others else (None, None)


def _prepared(
    rules: Rules,
    take: TakeRecord,
    columns: Columns,
    x: Transform | None,
    covariance: Floats | None,
    skew: Skew | None,
) -> tuple[ScoredTake, dict[str, ScoredTake | str]]:
    """The take as a whole, and by epoch: each ready, or why it isn't."""
    case = rules.case(take)
    anchor_s = case.anchor
    epochs = headset_samples(columns).epochs
    several = len(epochs) > 1
    # No one world spans several epochs, so as a whole such a take has no X to be compared by.
    whole = rules.protocol.prepare(
        columns, rules.reference, None if several else x, anchor_s=anchor_s, skew=skew
    )
    left_out = excluded(rules, take, columns)
    if not several:
        whole = replace(without(whole, left_out), x_covariance=covariance)
        return whole, {"all": whole}
    parts: dict[str, ScoredTake | str] = {}
    for epoch in epochs:
        segment = f"epoch:{epoch}"
        try:
            part = rules.protocol.prepare(_epoch(columns, epoch), rules.reference, x, skew=skew)
            part = without(part, left_out)
            parts[segment] = replace(part, segment=segment, x_covariance=covariance)
        except EstimationError as error:
            parts[segment] = str(error)
    return whole, parts


def excluded(rules: Rules, take: TakeRecord, columns: Columns) -> list[Ints]:
    """The spans (k, 2) [ns] of a take that its case declares not to be scored."""
    reference = reference_samples(columns, rules.reference)
    return [spans(columns, kind, reference) for kind in rules.case(take).exclude]


def _epoch(columns: Columns, epoch: int) -> Columns:
    samples = headset_samples(columns)
    return replace(columns, poses={**columns.poses, HEADSET: samples[samples.epoch == epoch]})


def _own_rows(rules: Rules, take: TakeRecord, whole: ScoredTake) -> Iterator[Row]:
    """What needs no X, of the take as a whole."""
    for family in rules.families:
        if "x" not in family.needs:
            for row in family_rows(rules, take, family, whole, Verdict(), kept_as="whole"):
                yield _with_offset_interval(row, whole)


def _with_offset_interval(row: Row, whole: ScoredTake) -> Row:
    if row.metric != "clock.offset" or row.value is None:
        return row
    interval = offset_interval(whole, row.value)
    if interval is None:
        return row
    return replace(row, ci_low=interval.low, ci_high=interval.high, ci_scope=interval.scope)


def _pose_rows(
    rules: Rules, take: TakeRecord, segment: str, part: ScoredTake | str, verdict: Verdict
) -> Iterator[Row]:
    """What needs X, of one epoch; where X or the epoch is wanting, why."""
    for family in rules.families:
        if "x" not in family.needs:
            continue
        if isinstance(part, ScoredTake) and part.x is not None:
            yield from family_rows(rules, take, family, part, verdict, kept_as=segment)
        else:
            failed = Verdict("failed", part) if isinstance(part, str) else verdict
            for value in absent_values([family]):
                yield rules.row(take, replace(value, segment=segment), failed)


def family_rows(
    rules: Rules,
    take: TakeRecord,
    family: Family,
    part: ScoredTake,
    verdict: Verdict,
    *,
    kept_as: str | None = None,
) -> list[Row]:
    """A family's rows. One that fails, a plugin's perhaps, costs its own rows and no others.

    `kept_as` says which part of the take this is, for what is computed once; None to compute it.
    """
    if family.of_take is None:
        return []
    try:
        compute = partial(_values, family, part)
        of = rules.reference, take.name, str(kept_as)
        name, code = f"metric {family.name}", family_code(family)
        once = kept_as is not None
        values = rules.stages.kept(name, compute, *of, code=code) if once else compute()
    except EstimationError as error:
        verdict, values = Verdict("skipped", str(error)), list(absent_values([family]))
    except Exception as error:
        why = f"metric {family.name} failed: {type(error).__name__}: {error}"
        verdict, values = Verdict("failed", why), list(absent_values([family]))
    return [rules.row(take, value, verdict) for value in values]


def _values(family: Family, part: ScoredTake) -> list[Value]:
    assert family.of_take is not None
    values = [replace(value, segment=part.segment) for value in family.of_take(part)]
    odd = next((v for v in values if v.value is not None and not np.isfinite(v.value)), None)
    if odd is not None:
        raise ValueError(f"{odd.metric} {odd.statistic} is {odd.value}")
    return values


def absent_values(families: Sequence[Family]) -> Iterator[Value]:
    """One value without a number for each metric, to carry the reason."""
    for family in families:
        if family.of_take is not None:
            for metric, unit in family.units.items():
                yield Value(metric, "value", None, unit, 0)


def with_intervals(
    rules: Rules,
    rows: Iterable[Row],
    name: str,
    models: Mapping[Key, ErrorModel],
    covariance: Floats | None,
) -> list[Row]:
    """The rows, those that have one with their interval over this take alone."""
    found = intervals([models], [covariance], [("", "")], rules.rng(name))
    return [with_interval(row, found) for row in rows]


def with_interval(row: Row, found: Mapping[tuple[str, str, str], Interval]) -> Row:
    """The row with the interval of its metric, point and statistic, if there is one."""
    interval = found.get((row.metric, row.point, row.statistic))
    if interval is None or row.band != "all" or row.value is None or row.variant != "main":
        return row
    return replace(row, ci_low=interval.low, ci_high=interval.high, ci_scope=interval.scope)
