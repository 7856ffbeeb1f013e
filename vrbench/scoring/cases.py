"""Scores one take against one reference: values, their intervals, and the gate's verdict."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from vrbench.errors import DataError, EstimationError
from vrbench.geometry import Floats
from vrbench.metrics.registry import Value
from vrbench.metrics.scored import ScoredTake
from vrbench.protocols.calibration import Calibration, Verdict
from vrbench.results.record import TakeRecord
from vrbench.results.tables import Member, Row, pool
from vrbench.scoring.family_rows import absent_values, family_rows
from vrbench.scoring.preparing import Prepared, prepared
from vrbench.scoring.rules import Rules, verdict_of
from vrbench.statistics.bootstrap import Interval
from vrbench.statistics.floor import floor_values
from vrbench.statistics.following import Key
from vrbench.statistics.of_scale import scale_intervals
from vrbench.statistics.relative import relative_models
from vrbench.statistics.uncertainty import (
    ErrorModel,
    error_models,
    intervals,
    offset_interval,
    translation_errors,
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
    translation = translation_errors(part)
    models = error_models(part, translation)
    if "rpe" in asked:
        models |= relative_models(part)
    found = intervals([models], [covariance], [("", "")], rules.rng(take.name))
    return models, found | (
        scale_intervals(part, translation, covariance) if "scale" in asked else {}
    )


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
    low, high = min(interval.low, row.value), max(interval.high, row.value)
    return replace(row, ci_low=low, ci_high=high, ci_scope=interval.scope)


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
    """The row with the interval of its metric, point and statistic, if there is one.

    The interval takes in what was found, where all such takes together would have less: an
    alignment may turn one by more than most.
    """
    interval = found.get((row.metric, row.point, row.statistic))
    if interval is None or row.band != "all" or row.value is None or row.variant != "main":
        return row
    low, high = min(interval.low, row.value), max(interval.high, row.value)
    return replace(row, ci_low=low, ci_high=high, ci_scope=interval.scope)
