"""Leaderboards: devices side by side, where and only where their numbers can be compared."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from vrbench.config.suite import Suite
from vrbench.errors import ConfigError
from vrbench.results.bundle import Bundle, TakeRecord
from vrbench.results.tables import STATUSES, Row, read_rows


@dataclass(frozen=True, slots=True, order=True)
class BoardKey:
    """What must be the same for numbers to stand on one board.

    Attributes:
        simulated: whether a simulator made them, which tells nothing of the headset.
        speed: of the motion as it was carried out, over its own.
    """

    suite: str
    suite_digest: str
    simulated: bool
    case: str
    condition: str
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
        epochs: most world frames in one take; None where not measured.
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
    epochs: int | None
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
        DataError: a run has no metrics yet, or they were changed.
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
        rows = read_rows(bundle.checked(f"metrics/{protocol}.csv"))
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
            suite=suite.label,
            suite_digest=bundle.record.suite_digest,
            simulated=bundle.record.kind == "simulated",
            case=take.case,
            condition=take.condition,
            motion=take.motion,
            motion_digest=take.motion_digest,
            protocol=protocol,
            reference=bundle.record.references[0],
            speed=round(take.speed / take.stretch, 6),
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
        if (row.case, row.condition, row.reference) == (key.case, key.condition, key.reference)
        and row.variant == "main"
    ]
    chosen = _ranking_row(mine, suite, takes)
    coverage = _extreme(min, mine, "coverage.valid")
    epochs = _extreme(max, mine, "coverage.epochs")
    status, reason = _standing(suite, takes, mine, chosen, coverage, epochs)
    shown = chosen if status not in ("failed", "invalid") else None
    device = bundle.record.device
    return Entry(
        rank=None,
        device=device.headset,
        firmware=device.firmware,
        logger=device.logger,
        lab=bundle.record.lab,
        value=shown.value if shown else None,
        low=shown.ci_low if shown else None,
        high=shown.ci_high if shown else None,
        floor=_floor(mine, suite.rank.point),
        unit=shown.unit if shown else "",
        takes=len(takes),
        mounts=len({take.mount for take in takes}),
        coverage=coverage,
        epochs=None if epochs is None else int(epochs),
        status=status,
        reason=reason,
        run=str(bundle.folder),
    )


def _ranking_row(rows: Sequence[Row], suite: Suite, takes: Sequence[TakeRecord]) -> Row | None:
    repeat = "all" if len(takes) > 1 else str(takes[0].repeat)
    rank = suite.rank
    wanted = (rank.metric, rank.point, rank.statistic, repeat, "all", "all")
    for row in rows:
        if (row.metric, row.point, row.statistic, row.repeat, row.band, row.segment) == wanted:
            return row
    return None


def _standing(
    suite: Suite,
    takes: Sequence[TakeRecord],
    rows: Sequence[Row],
    chosen: Row | None,
    coverage: float | None,
    epochs: float | None,
) -> tuple[str, str]:
    """`ok`, or why an entry isn't ranked; the gravest reason comes first."""
    troubled = [row for row in rows if row.status in ("failed", "invalid")]
    if troubled:
        worst = min(troubled, key=lambda row: STATUSES.index(row.status))
        return worst.status, worst.reason
    if chosen is None or chosen.value is None:
        return "failed", chosen.reason if chosen else f"{suite.rank.metric} was not computed"
    if chosen.status != "ok":
        return chosen.status, chosen.reason
    done = min(take.fraction for take in takes)
    if done < 1.0:
        return "not completed", f"the robot did {done * 100:.3g} % of the motion"
    if coverage is None:
        return "no coverage", "coverage was not computed"
    if coverage < suite.rank.min_coverage * 100:
        return "low coverage", f"the suite asks for {suite.rank.min_coverage:.0%} valid poses"
    if epochs is not None and epochs > 1:
        return "recentred", "each world frame of a take is aligned apart, which flatters it"
    if chosen.ci_scope not in ("mount", "sitting"):
        return (
            "take scope",
            "it speaks for these takes only: a rank takes two mounts of three repeats each",
        )
    return "ok", ""


def _extreme(
    choose: Callable[[Iterable[float]], float], rows: Sequence[Row], metric: str
) -> float | None:
    """The least or the largest of a metric among the takes; None where one of them has none."""
    found = [row.value for row in rows if row.metric == metric and row.repeat != "all"]
    known = [value for value in found if value is not None]
    return choose(known) if known and len(known) == len(found) else None


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
