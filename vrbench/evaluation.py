"""Evaluates: takes of a bundle -> metric rows. It sees takes and the suite, never a device."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

from vrbench.cache.stages import Stages, family_code
from vrbench.cache.store import Store
from vrbench.errors import EstimationError
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
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
from vrbench.scoring.baseline import baseline_rows
from vrbench.scoring.by_takes import by_takes
from vrbench.scoring.cases import Scored, score, unscored_take, with_interval
from vrbench.scoring.crosscheck import crosscheck_rows
from vrbench.scoring.loops import loop_rows
from vrbench.scoring.rules import Rules
from vrbench.scoring.variants import variant_rows
from vrbench.statistics.uncertainty import intervals
from vrbench.streams import Columns

# Told of each take as it is scored: its name, its place, how many there are.
Tell = Callable[[str, int, int], None]


def evaluate(
    bundle: Bundle,
    families: Sequence[Family],
    protocol: Protocol,
    tell: Tell,
    store: Store | None = None,
) -> list[Row]:
    """Scores a run; writes its metric table, its errors by phase, curves and `calibration.json`.

    Args:
        bundle: a complete run.
        families: the metrics to compute.
        protocol: how to score.
        tell: told of each take.
        store: what evaluations found before; None to compute everything.

    Returns:
        the rows written: of each take, of repeats together, and pooled.

    Raises:
        DataError: a take is gone, altered or unreadable; nothing is written.
    """
    suite = bundle.record.resolved_suite()
    joints = any("joints" in family.needs for family in families)
    stages = Stages.of(store, bundle.record, protocol, joints=joints)
    rows: list[Row] = []
    phases: list[PhaseRow] = []
    curves: list[TakeCurves] = []
    found: dict[str, list[Calibration]] = {}
    done, total = 0, len(bundle.record.takes) * len(bundle.record.references)
    for reference in bundle.record.references:
        rules = Rules(bundle.record, suite, families, protocol, reference, stages)
        calibrations = {
            mount: calibrated(bundle, protocol, reference, mount, stages)
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
            columns = stages.columns(bundle.sound(take), take.sha256)
            own = replace(rules, reference=protocol.reference(columns, reference))
            good, failures = usable(*calibrations[take.mount], body_shapes(columns, reference))
            scored = score(own, take, columns, good, failures)
            more = _more_rows(own, scored, columns, good)
            scored = replace(scored, rows=[*scored.rows, *more])
            rows += scored.rows
            of = own.reference, take.name
            phases += stages.kept("phases", partial(_phases, own, scored), *of)
            curves += stages.kept("curves", partial(_curves, own, scored, bins_for(total)), *of)
            groups[take.case, take.condition].append(scored)
        for group in groups.values():
            rows += _rows_of_repeats(rules, group)
            rows += _pooled(rules, group)
        rows += stages.kept("baseline", partial(_compared, rules, groups, phases), reference)
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
    stages.trim()
    return rows


def _more_rows(
    rules: Rules, scored: Scored, columns: Columns, calibrations: Mapping[str, Calibration]
) -> list[Row]:
    """What a take tells beside its own metrics: in other variants, by its loops, by two references.

    Variants and loops are scored by `ape`.
    """
    take, kept = scored.take, rules.stages.kept
    variants = partial(variant_rows, rules, scored, columns, calibrations)
    ape = next((family_code(f) for f in rules.families if f.name == "ape"), "")
    of = rules.reference, take.name
    return [
        *kept("variants", variants, *of, code=ape),
        *kept("loops", partial(loop_rows, rules, scored, columns), *of, code=ape),
        *kept("crosscheck", partial(crosscheck_rows, rules, take, columns), *of),
    ]


def _compared(
    rules: Rules, groups: Mapping[tuple[str, str], Sequence[Scored]], phases: Sequence[PhaseRow]
) -> list[Row]:
    return list(baseline_rows(rules, groups, phases))


def _phases(rules: Rules, scored: Scored) -> list[PhaseRow]:
    return list(phase_rows(scored.take, scored.whole, rules.reference))


def _curves(rules: Rules, scored: Scored, bins: int) -> list[TakeCurves]:
    if scored.whole is None:
        return []
    return [take_curves(scored.take, scored.whole, scored.parts, rules.reference, bins)]


def calibrated(
    bundle: Bundle, protocol: Protocol, reference: str, mount: int, stages: Stages | None = None
) -> tuple[dict[str, Calibration], dict[str, str], dict[str, Shapes]]:
    """The calibrations of a mount by take, why the others failed, and the bodies of all."""
    stages = stages or Stages()
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
            columns = stages.columns(bundle.sound(take), take.sha256)
            bodies[take.name] = body_shapes(columns, reference)
            compute = partial(_calibration, protocol.calibrate, columns, reference, take.name)
            found = stages.kept("calibrate", compute, reference, take.name)
            if isinstance(found, str):
                failures[take.name] = found
            else:
                good[take.name] = found
    return good, failures, bodies


def _calibration(
    calibrate: Callable[[Columns, str, str], Calibration],
    columns: Columns,
    reference: str,
    take: str,
) -> Calibration | str:
    """What a calibration take gives, or why it gives nothing."""
    try:
        return calibrate(columns, reference, take)
    except EstimationError as error:
        return str(error)


def _rows_of_repeats(rules: Rules, group: Sequence[Scored]) -> Iterator[Row]:
    """What only the repeats of a case and condition in one mount tell together."""
    for mount in dict.fromkeys(one.take.mount for one in group):
        members = [one for one in group if one.take.mount == mount]
        takes = [one.whole for one in members if one.whole is not None]
        worst = min((one.verdict for one in members), key=lambda v: STATUSES.index(v.status))
        for family in rules.families:
            if family.of_repeats is not None and takes:
                verdict = worst if "x" in family.needs else Verdict()
                compute = partial(_of_repeats, family.of_repeats, takes)
                first = members[0].take
                of = rules.reference, first.case, first.condition, str(mount)
                stage = f"metric {family.name} of repeats"
                for value in rules.stages.kept(stage, compute, *of, code=family_code(family)):
                    yield replace(rules.row(members[0].take, value, verdict), repeat="all")


def _of_repeats(
    compute: Callable[[Sequence[ScoredTake]], Iterable[Value]], takes: Sequence[ScoredTake]
) -> list[Value]:
    return list(compute(takes))


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
    if not pooled:
        return pooled
    of = group[0].take.case, group[0].take.condition
    sitting, found = rules.record.sitting, {}
    if all(one.models for one in group):
        found = rules.stages.kept(
            "pool",
            lambda: intervals(
                [one.models for one in group],
                [one.x_covariance for one in group],
                [(sitting, str(one.take.mount)) for one in group],
                rules.rng(*of),
            ),
            *(rules.reference, *of),
        )
        pooled = [with_interval(row, found) for row in pooled]
    places = {member: (sitting, member[0]) for member in members}
    modelled = {(metric, point) for metric, point, _ in found}
    return by_takes(pooled, rows, places, modelled, rules.rng(*of, "takes"))
