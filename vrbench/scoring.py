"""Scores one take against one reference: values, their intervals, and the gate's verdict."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from zlib import crc32

import numpy as np

from vrbench.clocks import ClockMap
from vrbench.config.suite import Suite
from vrbench.errors import DataError, EstimationError
from vrbench.geometry import Floats, Transform
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.protocols.calibration import Calibration, Limits, Verdict, gate, mean_x
from vrbench.protocols.protocol import HEADSET, Protocol, headset_samples
from vrbench.results.bundle import RunRecord, TakeRecord
from vrbench.results.tables import Row
from vrbench.statistics.bootstrap import Interval
from vrbench.statistics.floor import noise_floor
from vrbench.statistics.uncertainty import ErrorModel, Key, error_models, intervals, moved_x
from vrbench.streams import Columns

FLOOR_DRAWS = 40
# What a headset whose clock was asked is known to be off by: its poses are on the host's clock.
ASKED = ClockMap(np.array([0], dtype=np.int64), np.array([0.0]))
SUFFICIENT = ("ok", "unbracketed", "extrapolated")


@dataclass(frozen=True, slots=True)
class Rules:
    """What is the same for all takes of a run.

    Attributes:
        record: the run's.
        suite: its suite, resolved.
        families: the metrics to compute.
        protocol: how to score.
        reference: `robot`, `mocap`, or another robot's log that the protocol asks for.
    """

    record: RunRecord
    suite: Suite
    families: Sequence[Family]
    protocol: Protocol
    reference: str

    def row(self, take: TakeRecord, value: Value, verdict: Verdict) -> Row:
        """A value of a take as a row; what has no number says why."""
        status, reason = verdict.status, verdict.reason
        if value.value is None and status in SUFFICIENT:
            status, reason = "skipped", value.reason
        return Row(
            protocol=self.protocol.name,
            device=self.record.device.headset,
            suite=self.suite.label,
            case=take.case,
            condition=take.condition,
            sitting=self.record.sitting,
            mount=str(take.mount),
            repeat=str(take.repeat),
            segment=value.segment,
            reference=self.reference,
            variant=value.variant,
            metric=value.metric,
            point=value.point,
            band=value.band,
            statistic=value.statistic,
            value=value.value,
            unit=value.unit,
            samples=value.samples,
            status=status,
            reason=reason,
        )

    def rng(self, *names: str) -> np.random.Generator:
        """A generator of its own for each name, the same in every evaluation."""
        return np.random.default_rng([crc32(name.encode()) for name in (self.reference, *names)])


@dataclass(frozen=True, slots=True, eq=False)
class Scored:
    """A take, scored.

    Attributes:
        take: its record.
        rows: its rows.
        whole: the take made ready, for what only several takes tell together; None if it failed.
        models: of its errors, by metric and point; empty where it has several epochs.
    """

    take: TakeRecord
    rows: Sequence[Row]
    whole: ScoredTake | None = None
    models: Mapping[Key, ErrorModel] = field(default_factory=dict)


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
        calibrations: those of its mount that succeeded, by take; its own is not used to score it.
        failures: why the others didn't.
    """
    others = [c for name, c in calibrations.items() if name != take.name]
    try:
        x, covariance = _mounting(rules, columns, others)
        whole, parts = _prepared(rules, take, columns, x, covariance)
    except (EstimationError, DataError) as error:
        failed = Verdict("failed", str(error))
        return Scored(take, [rules.row(take, value, failed) for value in _absent(rules.families)])
    verdict = _verdict(rules, take, whole, others, failures)
    rows = list(_own_rows(rules, take, whole))
    models: Mapping[Key, ErrorModel] = {}
    for segment, part in parts.items():
        found = list(_pose_rows(rules, take, segment, part, verdict))
        if isinstance(part, ScoredTake) and x is not None:
            models = error_models(part)
            found = _with_intervals(rules, found, take.name, models, covariance)
            found += [rules.row(take, v, verdict) for v in _floor(rules, part)]
        rows += found
    rows += _variants(rules, take, columns, calibrations, x, verdict)
    return Scored(take, rows, whole, models if len(parts) == 1 else {})


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
) -> tuple[ScoredTake, dict[str, ScoredTake | str]]:
    """The take as a whole, and by epoch: each ready, or why it isn't."""
    anchor_s = rules.suite.case(take.case).anchor
    epochs = headset_samples(columns).epochs
    several = len(epochs) > 1
    # No one world spans several epochs, so as a whole such a take has no X to be compared by.
    whole = rules.protocol.prepare(
        columns, rules.reference, None if several else x, anchor_s=anchor_s
    )
    if not several:
        whole = replace(whole, x_covariance=covariance)
        return whole, {"all": whole}
    parts: dict[str, ScoredTake | str] = {}
    for epoch in epochs:
        segment = f"epoch:{epoch}"
        try:
            part = rules.protocol.prepare(_epoch(columns, epoch), rules.reference, x)
            parts[segment] = replace(part, segment=segment, x_covariance=covariance)
        except EstimationError as error:
            parts[segment] = str(error)
    return whole, parts


def _epoch(columns: Columns, epoch: int) -> Columns:
    samples = headset_samples(columns)
    return replace(columns, poses={**columns.poses, HEADSET: samples[samples.epoch == epoch]})


def _own_rows(rules: Rules, take: TakeRecord, whole: ScoredTake) -> Iterator[Row]:
    """What needs no X, of the take as a whole."""
    for family in rules.families:
        if family.of_take is not None and "x" not in family.needs:
            for value in family.of_take(whole):
                yield rules.row(take, value, Verdict())


def _pose_rows(
    rules: Rules, take: TakeRecord, segment: str, part: ScoredTake | str, verdict: Verdict
) -> Iterator[Row]:
    """What needs X, of one epoch; where X or the epoch is wanting, why."""
    families = [f for f in rules.families if f.of_take is not None and "x" in f.needs]
    if isinstance(part, str):
        verdict, values = Verdict("failed", part), _absent(families)
    elif part.x is None:
        values = _absent(families)
    else:
        values = (value for f in families if f.of_take is not None for value in f.of_take(part))
    for value in values:
        yield rules.row(take, replace(value, segment=segment), verdict)


def _absent(families: Sequence[Family]) -> Iterator[Value]:
    """One value without a number for each metric, to carry the reason."""
    for family in families:
        if family.of_take is not None:
            for metric, unit in family.units.items():
                yield Value(metric, "value", None, unit, 0)


def _with_intervals(
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


def _floor(rules: Rules, part: ScoredTake) -> Iterator[Value]:
    """The noise floor at both points, with its terms; the total only where all are known."""
    accuracy = rules.record.accuracy.get(rules.reference)
    if part.x is None or part.x_covariance is None or part.offset_sigma_s is None:
        return
    rng = rules.rng("floor")
    draws = moved_x(
        part.x,
        rng.multivariate_normal(np.zeros(6), part.x_covariance, FLOOR_DRAWS, method="eigh"),
    )
    for point in ("eye", "tcp"):
        floor = noise_floor(
            part.reference,
            part.x,
            draws,
            point,
            reference_accuracy_m=accuracy.metres if accuracy else 0.0,
            offset_sigma_s=part.offset_sigma_s,
        )
        terms: dict[str, float | None] = {
            "x": floor.x,
            "offset": floor.offset,
            "interpolation": floor.interpolation,
            "reference": floor.reference if accuracy else None,
            "total": floor.total if accuracy else None,
        }
        unknown = f"the accuracy of the {rules.reference} is not stated in the rig"
        for name, metres in terms.items():
            yield Value(
                f"floor.{name}",
                "value",
                None if metres is None else metres * 1e3,
                "mm",
                len(part.estimate),
                point=point,
                segment=part.segment,
                reason=unknown if metres is None else "",
            )


def _verdict(
    rules: Rules,
    take: TakeRecord,
    scored: ScoredTake,
    others: Sequence[Calibration],
    failures: Mapping[str, str],
) -> Verdict:
    """What the gate says. A calibration take is bracketed by its agreement with the others."""
    if rules.protocol.given_x is not None:
        return Verdict()
    if not others and take.role == "calibration" and take.name not in failures:
        return Verdict("skipped", "no other calibration of this mount to score it with")
    if not others and failures:
        told = "; ".join(f"{name}: {why}" for name, why in failures.items())
        return Verdict("invalid", f"no calibration of this mount succeeded: {told}")
    bounds = rules.suite.gate
    limits = Limits(
        bounds.handeye_translation, bounds.handeye_rotation, bounds.max_age, bounds.bracket
    )
    start, end = int(scored.reference.t[0]), int(scored.reference.t[-1])
    verdict = gate(others, start, end, scored.truth, limits)
    if take.role == "calibration" and verdict.status == "unbracketed":
        return Verdict()
    return verdict


def _variants(
    rules: Rules,
    take: TakeRecord,
    columns: Columns,
    calibrations: Mapping[str, Calibration],
    x: Transform | None,
    verdict: Verdict,
) -> list[Row]:
    """APE with X fitted on this very take, and at the clock that the headset itself told."""
    ape = next((f.of_take for f in rules.families if f.name == "ape"), None)
    calibrate = rules.protocol.calibrate
    if ape is None or calibrate is None or len(headset_samples(columns).epochs) > 1:
        return []
    anchor_s = rules.suite.case(take.case).anchor
    prepared: dict[str, tuple[ScoredTake, Verdict]] = {}
    try:
        own = calibrations.get(take.name) or calibrate(columns, rules.reference, take.name)
        best = rules.protocol.prepare(columns, rules.reference, own.x, anchor_s=anchor_s)
        prepared["in-sample"] = best, Verdict()
        if x is not None and "headset" in columns.clocks:
            told = rules.protocol.prepare(
                columns, rules.reference, x, anchor_s=anchor_s, measured=ASKED
            )
            prepared["fixed-offset"] = told, verdict
    except (EstimationError, DataError):
        # A motion that can't calibrate has no in-sample number; its own rows stand without.
        pass
    return [
        rules.row(take, replace(value, variant=variant), ruling)
        for variant, (scored, ruling) in prepared.items()
        for value in ape(scored)
    ]
