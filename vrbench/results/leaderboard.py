"""Leaderboards: devices side by side, where and only where their numbers can be compared."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from vrbench.config.suite import Suite
from vrbench.errors import ConfigError
from vrbench.results.bundle import Bundle, TakeRecord
from vrbench.results.tables import STATUSES, Row, read_rows


@dataclass(frozen=True, slots=True, order=True)
class BoardKey:
    """What must be the same for numbers to stand on one board."""

    suite: str
    suite_digest: str
    case: str
    motion: str
    motion_digest: str
    protocol: str
    reference: str
    speed: float


@dataclass(frozen=True, slots=True)
class Entry:
    """One device on a board.

    Attributes:
        rank: from 1; None for an entry that is listed but not ranked.
        value: the ranking number; None where there is none.
        low: lower end of its interval,
        high: and its upper end.
        floor: the largest noise floor among the takes, in the same unit; None where it isn't known.
        takes: takes the number rests on.
        mounts: mounts among them.
        coverage: least share of valid poses among the takes [%]; None where not measured.
        status: `ok`, or why the entry isn't ranked,
        reason: in words.
        run: the bundle it comes from.
    """

    rank: int | None
    device: str
    firmware: str
    logger: str
    lab: str
    value: float | None
    low: float | None
    high: float | None
    floor: float | None
    unit: str
    takes: int
    mounts: int
    coverage: float | None
    status: str
    reason: str
    run: str


@dataclass(frozen=True, slots=True)
class Board:
    """Entries that can be compared, best first; those without a rank come last."""

    key: BoardKey
    metric: str
    entries: Sequence[Entry]


def leaderboard(bundles: Iterable[Bundle], protocol: str) -> list[Board]:
    """All boards of these runs: one for each thing that must be the same.

    Raises:
        ConfigError: one run is given twice.
        DataError: a run has no metrics yet.
    """
    boards: dict[BoardKey, list[Entry]] = defaultdict(list)
    metrics: dict[BoardKey, str] = {}
    seen: set[str] = set()
    for bundle in bundles:
        where = str(bundle.folder.resolve())
        if where in seen:
            raise ConfigError("the run is given twice", file=bundle.folder)
        seen.add(where)
        suite = bundle.record.resolved_suite()
        rows = read_rows(bundle.folder / "metrics" / f"{protocol}.csv")
        for key, takes in _groups(bundle, suite, protocol).items():
            rank = suite.rank
            metrics[key] = f"{rank.metric} {rank.statistic} at the {rank.point}"
            boards[key].append(_entry(bundle, suite, key, takes, rows))
    return [Board(key, metrics[key], _ranked(boards[key])) for key in sorted(boards)]


def _groups(bundle: Bundle, suite: Suite, protocol: str) -> dict[BoardKey, list[TakeRecord]]:
    """The ranked takes of a run by board: scored cases; calibrations where there are no others."""
    takes = [take for take in bundle.record.takes if take.role == "scored"]
    groups: dict[BoardKey, list[TakeRecord]] = defaultdict(list)
    for take in takes or bundle.record.takes:
        key = BoardKey(
            suite.label,
            bundle.record.suite_digest,
            take.case,
            take.motion,
            take.motion_digest,
            protocol,
            bundle.record.references[0],
            take.speed,
        )
        groups[key].append(take)
    return groups


def _entry(
    bundle: Bundle, suite: Suite, key: BoardKey, takes: Sequence[TakeRecord], rows: Sequence[Row]
) -> Entry:
    """The pooled ranking number of several takes, or that of the only one."""
    mine = [
        row
        for row in rows
        if row.case == key.case
        and row.reference == key.reference
        and row.variant == "main"
        and row.band == "all"
        and row.segment == "all"
    ]
    which = "all" if len(takes) > 1 else str(takes[0].repeat)
    ranking = [
        row
        for row in mine
        if row.metric == suite.rank.metric
        and row.point == suite.rank.point
        and row.statistic == suite.rank.statistic
    ]
    chosen = next((row for row in ranking if row.repeat == which), None)
    # A take that failed or is invalid has no number: nothing is pooled, and it is told why.
    troubled = [row for row in mine if row.status in ("failed", "invalid")]
    status, reason = "failed", "the metric was not computed"
    if troubled:
        worst = min(troubled, key=lambda row: STATUSES.index(row.status))
        status, reason, chosen = worst.status, worst.reason, None
    elif chosen is not None:
        status, reason = chosen.status, chosen.reason
    if status == "ok" and chosen is not None and chosen.ci_scope == "take":
        status = "take scope"
        reason = "its interval speaks for these takes only: two mounts of three repeats are needed"
    covered = [row.value for row in mine if row.metric == "coverage.valid" and row.repeat != "all"]
    coverage = min((c for c in covered if c is not None), default=None)
    floor = suite.rank.min_coverage * 100
    if status == "ok" and (coverage is None or coverage < floor):
        status = "low coverage" if coverage is not None else "no coverage"
        reason = f"the suite asks for {floor:g} % valid poses"
    device = bundle.record.device
    return Entry(
        rank=None,
        device=device.headset,
        firmware=device.firmware,
        logger=device.logger,
        lab=bundle.record.lab,
        value=chosen.value if chosen else None,
        low=chosen.ci_low if chosen else None,
        high=chosen.ci_high if chosen else None,
        floor=_floor(mine, suite.rank.point),
        unit=chosen.unit if chosen else "",
        takes=len(takes),
        mounts=len({take.mount for take in takes}),
        coverage=coverage,
        status=status,
        reason=reason,
        run=str(bundle.folder),
    )


def _floor(rows: Sequence[Row], point: str) -> float | None:
    """The largest total noise floor among the takes; None where one of them has none."""
    floors = [row.value for row in rows if row.metric == "floor.total" and row.point == point]
    known = [value for value in floors if value is not None]
    return max(known) if known and len(known) == len(floors) else None


def _ranked(entries: Sequence[Entry]) -> list[Entry]:
    """Ranks by value those that may be ranked; lists the others behind them, by value too."""

    def by_value(entry: Entry) -> tuple[bool, float, str]:
        return entry.value is None, entry.value or 0.0, entry.run

    sound = sorted((entry for entry in entries if entry.status == "ok"), key=by_value)
    others = sorted((entry for entry in entries if entry.status != "ok"), key=by_value)
    return [replace(entry, rank=place) for place, entry in enumerate(sound, 1)] + others
