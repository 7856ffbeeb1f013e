"""Evaluates: takes of a bundle -> metric rows. It sees takes and the suite, never a device."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from vrbench.comparison import baseline_rows
from vrbench.crosscheck import crosscheck_rows
from vrbench.errors import EstimationError
from vrbench.loops import loop_rows
from vrbench.metrics.registry import Family
from vrbench.protocols.body import Shapes, body_shapes, usable
from vrbench.protocols.calibration import Calibration, Verdict
from vrbench.protocols.protocol import Protocol
from vrbench.recording.interrupt import Interrupt
from vrbench.results.bundle import Bundle
from vrbench.results.calibrations import CALIBRATIONS, write_calibrations
from vrbench.results.phases import PhaseRow, phase_rows, write_phases
from vrbench.results.plot_curves import take_curves
from vrbench.results.plot_data import TakeCurves, bins_for, curves_file, write_curves
from vrbench.results.tables import STATUSES, Member, Row, pool, write_rows
from vrbench.rules import Rules
from vrbench.scoring import Scored, score, unscored_take, with_interval
from vrbench.statistics.uncertainty import intervals
from vrbench.variants import variant_rows

# Told of each take as it is scored: its name, its place, how many there are.
Tell = Callable[[str, int, int], None]


def evaluate(
    bundle: Bundle, families: Sequence[Family], protocol: Protocol, tell: Tell
) -> list[Row]:
    """Scores a run; writes its metric table, its errors by phase, curves and `calibration.json`.

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
    rows: list[Row] = []
    phases: list[PhaseRow] = []
    curves: list[TakeCurves] = []
    found: dict[str, list[Calibration]] = {}
    done, total = 0, len(bundle.record.takes) * len(bundle.record.references)
    for reference in bundle.record.references:
        rules = Rules(bundle.record, suite, families, protocol, reference)
        calibrations = {
            mount: calibrated(bundle, protocol, reference, mount)
            for mount in sorted({take.mount for take in bundle.record.takes})
        }
        found[reference] = [c for good, *_ in calibrations.values() for c in good.values()]
        groups: dict[tuple[str, str], list[Scored]] = defaultdict(list)
        for take in bundle.record.takes:
            tell(take.name, done, total)
            done += 1
            if take.status != "ok":
                failed = unscored_take(rules, take, Verdict(take.status, take.reason))
                rows += failed.rows
                groups[take.case, take.condition].append(failed)
                continue
            columns = bundle.columns(take)
            own = replace(rules, reference=protocol.reference(columns, reference))
            good, failures = usable(*calibrations[take.mount], body_shapes(columns, reference))
            scored = score(own, take, columns, good, failures)
            variants = variant_rows(own, scored, columns, good)
            loops = loop_rows(own, scored, columns)
            both = crosscheck_rows(own, take, columns)
            scored = replace(scored, rows=[*scored.rows, *variants, *loops, *both])
            rows += scored.rows
            phases += phase_rows(take, scored.whole, own.reference)
            if scored.whole is not None:
                curves.append(
                    take_curves(take, scored.whole, scored.parts, own.reference, bins_for(total))
                )
            groups[take.case, take.condition].append(scored)
        for group in groups.values():
            rows += _rows_of_repeats(rules, group)
            rows += _pooled(rules, group)
        rows += baseline_rows(rules, groups, phases)
    table, by_phase = f"metrics/{protocol.name}.csv", f"metrics/{protocol.name}.phase.csv"
    # tables and the digests that run.json has of them go together
    with Interrupt():
        write_rows(rows, bundle.folder / table)
        write_phases(phases, bundle.folder / by_phase)
        write_curves(curves, protocol.name, bundle.folder / curves_file(protocol.name))
        if protocol.calibrate is not None:
            write_calibrations(bundle.folder / CALIBRATIONS, protocol.name, found)
        written = [table, by_phase, curves_file(protocol.name)]
        bundle.enter(*written, *([] if protocol.calibrate is None else [CALIBRATIONS]))
    return rows


def calibrated(
    bundle: Bundle, protocol: Protocol, reference: str, mount: int
) -> tuple[dict[str, Calibration], dict[str, str], dict[str, Shapes]]:
    """The calibrations of a mount by take, why the others failed, and the bodies of all."""
    good: dict[str, Calibration] = {}
    failures: dict[str, str] = {}
    bodies: dict[str, Shapes] = {}
    if protocol.calibrate is None:
        return good, failures, bodies
    for take in bundle.record.takes:
        if take.mount == mount and take.role != "scored" and take.status != "skipped":
            if take.status == "failed":
                failures[take.name] = take.reason
                continue
            columns = bundle.columns(take)
            bodies[take.name] = body_shapes(columns, reference)
            try:
                good[take.name] = protocol.calibrate(columns, reference, take.name)
            except EstimationError as error:
                failures[take.name] = str(error)
    return good, failures, bodies


def _rows_of_repeats(rules: Rules, group: Sequence[Scored]) -> Iterator[Row]:
    """What only the repeats of a case and condition in one mount tell together."""
    for mount in dict.fromkeys(one.take.mount for one in group):
        members = [one for one in group if one.take.mount == mount]
        takes = [one.whole for one in members if one.whole is not None]
        worst = min((one.verdict for one in members), key=lambda v: STATUSES.index(v.status))
        for family in rules.families:
            if family.of_repeats is not None and takes:
                verdict = worst if "x" in family.needs else Verdict()
                for value in family.of_repeats(takes):
                    yield replace(rules.row(members[0].take, value, verdict), repeat="all")


def _pooled(rules: Rules, group: Sequence[Scored]) -> list[Row]:
    """The rows of all takes of a case and condition together, with their intervals."""
    members: dict[Member, str] = {
        (str(one.take.mount), str(one.take.repeat)): one.verdict.reason
        if one.verdict.status == "failed"
        else ""
        for one in group
    }
    rows = [row for one in group for row in one.rows if row.segment == "all"]
    pooled = pool(rows, ("mount", "repeat"), members)
    if not pooled or not all(one.models for one in group):
        return pooled
    found = intervals(
        [one.models for one in group],
        [one.x_covariance for one in group],
        [(rules.record.sitting, str(one.take.mount)) for one in group],
        rules.rng(group[0].take.case, group[0].take.condition),
    )
    return [with_interval(row, found) for row in pooled]
