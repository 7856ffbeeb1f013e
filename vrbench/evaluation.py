"""Evaluates: takes of a bundle -> metric rows. It sees takes and the suite, never a device."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from vrbench.errors import DataError, EstimationError
from vrbench.metrics.registry import Family
from vrbench.protocols.calibration import Calibration, Verdict, mean_x
from vrbench.protocols.protocol import Protocol
from vrbench.results.bundle import Bundle, TakeRecord
from vrbench.results.calibrations import write_calibrations
from vrbench.results.phases import PhaseRow, phase_rows, write_phases
from vrbench.results.tables import Row, pool, write_rows
from vrbench.scoring import Rules, Scored, score, with_interval
from vrbench.statistics.uncertainty import intervals
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
    """Scores a run; writes its metric table, its errors by phase, and `calibration.json`.

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
    references = bundle.record.references
    rows: list[Row] = []
    phases: list[PhaseRow] = []
    found: dict[str, list[Calibration]] = {}
    done, total = 0, len(decoded) * len(references)
    for reference in references:
        rules = Rules(bundle.record, suite, families, protocol, reference)
        mine: list[Row] = []
        cases: dict[str, list[tuple[Scored, _Mount]]] = defaultdict(list)
        for mount in _mounts(decoded, protocol, reference).values():
            found.setdefault(reference, []).extend(mount.calibrations.values())
            scored: list[Scored] = []
            for take, columns in mount.takes:
                tell(take.name, done, total)
                done += 1
                own = replace(rules, reference=protocol.reference(columns, reference))
                scored.append(score(own, take, columns, mount.calibrations, mount.failures))
                cases[take.case].append((scored[-1], mount))
            mine += [row for one in scored for row in one.rows]
            mine += _rows_of_repeats(rules, scored)
            phases += [row for one in scored for row in phase_rows(one.take, one.whole, reference)]
        mine += pool(mine, "segment")
        for case, members in cases.items():
            mine += _pooled(rules, case, mine, members)
        rows += mine
    write_rows(rows, bundle.folder / "metrics" / f"{protocol.name}.csv")
    write_phases(phases, bundle.folder / "metrics" / f"{protocol.name}.phase.csv")
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


def _rows_of_repeats(rules: Rules, scored: Sequence[Scored]) -> Iterator[Row]:
    """What only the repeats of a case in one mount tell together."""
    for case in dict.fromkeys(one.take.case for one in scored):
        group = [one for one in scored if one.take.case == case and one.whole is not None]
        for family in rules.families:
            if family.of_repeats is not None and group:
                takes = [one.whole for one in group if one.whole is not None]
                for value in family.of_repeats(takes):
                    yield replace(rules.row(group[0].take, value, Verdict()), repeat="all")


def _pooled(
    rules: Rules, case: str, rows: Sequence[Row], members: Sequence[tuple[Scored, _Mount]]
) -> list[Row]:
    """The rows of all takes of a case together, with their intervals."""
    pooled = pool([row for row in rows if row.case == case], "mount", "repeat")
    if not pooled or not all(one.models for one, _ in members):
        return pooled
    covariances = []
    for one, mount in members:
        others = [c for name, c in mount.calibrations.items() if name != one.take.name]
        covariances.append(mean_x(others)[1] if others else None)
    places = [(rules.record.sitting, str(one.take.mount)) for one, _ in members]
    found = intervals([one.models for one, _ in members], covariances, places, rules.rng(case))
    return [with_interval(row, found) for row in pooled]
