"""Evaluates: takes of a bundle -> metric rows. It sees takes and the suite, never a device."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from vrbench.config.suite import Suite
from vrbench.errors import DataError, EstimationError
from vrbench.geometry import Transform
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.protocols.calibration import Calibration, Limits, Verdict, gate, mean_x
from vrbench.protocols.protocol import Protocol
from vrbench.results.bundle import Bundle, TakeRecord
from vrbench.results.calibrations import write_calibrations
from vrbench.results.tables import Row, pool, write_rows
from vrbench.streams import Columns

# Told of each take as it is scored: its name, its place, how many there are.
Tell = Callable[[str, int, int], None]


@dataclass(slots=True)
class _Mount:
    """The takes of one mount, decoded, and what calibrates them."""

    takes: list[tuple[TakeRecord, Columns]] = field(default_factory=list)
    calibrations: dict[str, Calibration] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)


def evaluate(
    bundle: Bundle, families: Sequence[Family], protocol: Protocol, tell: Tell
) -> list[Row]:
    """Scores a run and writes `metrics/<protocol>.csv` and `calibration.json`.

    Args:
        bundle: a complete run.
        families: the metrics to compute.
        protocol: how to score.
        tell: told of each take.

    Returns:
        the rows written: of each take, of repeats together, and pooled.

    Raises:
        DataError: a take is gone, altered or unreadable; nothing is written.
    """
    suite = bundle.record.resolved_suite()
    decoded = [(take, bundle.columns(take)) for take in bundle.record.takes]
    rows: list[Row] = []
    found: dict[str, list[Calibration]] = {}
    total = len(decoded) * len(bundle.record.references)
    done = 0
    for reference in bundle.record.references:
        for mount in _mounts(decoded, protocol, reference).values():
            found.setdefault(reference, []).extend(mount.calibrations.values())
            scored: dict[str, list[tuple[TakeRecord, ScoredTake]]] = defaultdict(list)
            for take, columns in mount.takes:
                tell(take.name, done, total)
                done += 1
                stream = protocol.reference(columns, reference)
                scorer = _Scorer(bundle, suite, families, protocol, stream, take)
                rows += scorer.rows(columns, mount)
                if scorer.scored is not None:
                    scored[take.case].append((take, scorer.scored))
            for group in scored.values():
                rows += _rows_of_repeats(bundle, suite, families, protocol, reference, group)
    rows += pool(rows)
    write_rows(rows, bundle.folder / "metrics" / f"{protocol.name}.csv")
    if protocol.calibrate is not None:
        write_calibrations(bundle.folder / "calibration.json", protocol.name, found)
    return rows


def _mounts(
    decoded: Iterable[tuple[TakeRecord, Columns]], protocol: Protocol, reference: str
) -> dict[int, _Mount]:
    mounts: dict[int, _Mount] = defaultdict(_Mount)
    for take, columns in decoded:
        mount = mounts[take.mount]
        mount.takes.append((take, columns))
        if take.role == "calibration" and protocol.calibrate is not None:
            try:
                mount.calibrations[take.name] = protocol.calibrate(columns, reference, take.name)
            except (EstimationError, DataError) as error:
                mount.failures[take.name] = str(error)
    return mounts


@dataclass(slots=True)
class _Scorer:
    """Scores one take against one reference."""

    bundle: Bundle
    suite: Suite
    families: Sequence[Family]
    protocol: Protocol
    reference: str
    take: TakeRecord
    scored: ScoredTake | None = None

    def rows(self, columns: Columns, mount: _Mount) -> list[Row]:
        others = [c for name, c in mount.calibrations.items() if name != self.take.name]
        try:
            x = self._x(others, columns)
            self.scored = self._prepare(columns, x)
        except (EstimationError, DataError) as error:
            return [self._row(v, Verdict("failed", str(error))) for v in self._empty()]
        verdict = self._verdict(others, mount, self.scored)
        rows: list[Row] = []
        for family in self.families:
            if family.of_take is None:
                continue
            if x is None and "x" in family.needs:
                rows += [self._row(v, verdict) for v in self._empty([family])]
                continue
            ruling = verdict if "x" in family.needs else Verdict()
            rows += [self._row(value, ruling) for value in family.of_take(self.scored)]
        return rows + self._in_sample(columns, mount)

    def _x(self, others: Sequence[Calibration], columns: Columns) -> Transform | None:
        if self.protocol.given_x is not None:
            return self.protocol.given_x(columns)
        return mean_x(others) if others else None

    def _prepare(self, columns: Columns, x: Transform | None) -> ScoredTake:
        anchor_s = self.suite.case(self.take.case).anchor
        return self.protocol.prepare(columns, self.reference, x, anchor_s=anchor_s)

    def _verdict(self, others: Sequence[Calibration], mount: _Mount, scored: ScoredTake) -> Verdict:
        """What the gate says. A calibration take is bracketed by its agreement with the others."""
        if self.protocol.given_x is not None:
            return Verdict()
        limits = Limits(
            self.suite.gate.handeye_translation,
            self.suite.gate.handeye_rotation,
            self.suite.gate.max_age,
            self.suite.gate.bracket,
        )
        if not others and self.take.role == "calibration":
            return Verdict("skipped", "no other calibration of this mount to score it with")
        start, end = int(scored.reference.t[0]), int(scored.reference.t[-1])
        verdict = gate(others, start, end, scored.truth, limits)
        if self.take.role == "calibration" and verdict.status == "unbracketed":
            return Verdict()
        if not others and mount.failures:
            told = "; ".join(f"{name}: {why}" for name, why in mount.failures.items())
            return Verdict("invalid", f"no calibration of this mount succeeded: {told}")
        return verdict

    def _in_sample(self, columns: Columns, mount: _Mount) -> list[Row]:
        """APE with X fitted on the very take that is scored: better than it can truly be."""
        ape = [f for f in self.families if f.name == "ape" and f.of_take is not None]
        if not ape or self.protocol.calibrate is None:
            return []
        try:
            own = mount.calibrations.get(self.take.name) or self.protocol.calibrate(
                columns, self.reference, self.take.name
            )
            scored = self._prepare(columns, own.x)
        except (EstimationError, DataError):
            return []
        values = ape[0].of_take(scored) if ape[0].of_take else ()
        return [self._row(replace(value, variant="in-sample"), Verdict()) for value in values]

    def _empty(self, families: Sequence[Family] | None = None) -> Iterable[Value]:
        """One value without a number for each metric, to carry the reason."""
        for family in self.families if families is None else families:
            for metric, unit in family.units.items():
                if family.of_take is not None:
                    yield Value(metric, "value", None, unit, 0)

    def _row(self, value: Value, verdict: Verdict) -> Row:
        return _row(
            self.bundle, self.suite, self.protocol, self.reference, self.take, value, verdict
        )


def _rows_of_repeats(
    bundle: Bundle,
    suite: Suite,
    families: Sequence[Family],
    protocol: Protocol,
    reference: str,
    group: Sequence[tuple[TakeRecord, ScoredTake]],
) -> list[Row]:
    """What only the repeats of a case in one mount tell together."""
    takes = [scored for _, scored in group]
    first = group[0][0]
    return [
        replace(_row(bundle, suite, protocol, reference, first, value, Verdict()), repeat="all")
        for family in families
        if family.of_repeats is not None
        for value in family.of_repeats(takes)
    ]


def _row(
    bundle: Bundle,
    suite: Suite,
    protocol: Protocol,
    reference: str,
    take: TakeRecord,
    value: Value,
    verdict: Verdict,
) -> Row:
    status, reason = verdict.status, verdict.reason
    if value.value is None and status in ("ok", "unbracketed", "extrapolated"):
        status, reason = "skipped", value.reason
    return Row(
        protocol=protocol.name,
        device=bundle.record.device.headset,
        suite=suite.label,
        case=take.case,
        condition=take.condition,
        sitting=bundle.record.sitting,
        mount=str(take.mount),
        repeat=str(take.repeat),
        segment=value.segment,
        reference=reference,
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


def worst(rows: Sequence[Row]) -> Mapping[str, str]:
    """Reasons of the cases that are failed or invalid, by take."""
    return {
        f"{row.case} m{row.mount} r{row.repeat} ({row.status})": row.reason
        for row in rows
        if row.status in ("failed", "invalid") and row.variant == "main"
    }
