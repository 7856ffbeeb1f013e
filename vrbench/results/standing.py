"""What one run says of its device on one board, and whether that may be ranked."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from vrbench.config.case import UNCOVERED
from vrbench.config.ranking import POOLED
from vrbench.config.schedule import DEFAULT
from vrbench.config.suite import Suite
from vrbench.errors import DataError
from vrbench.results.board import FLOORED, STATISTICS, BoardKey
from vrbench.results.bundle import Bundle
from vrbench.results.record import RECORD, RunRecord, TakeRecord
from vrbench.results.selection import select_rows
from vrbench.results.tables import STATUSES, Row

# A take's number, and how many samples it rests on.
Sampled = tuple[float, int]


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """A run on a board.

    Attributes:
        bundle: the run,
        suite: and its suite.
        key: of the board.
        takes: the takes that the number rests on.
        before: for a board of changes, those of the baseline.
        row: the ranking number; None where there is none.
        pooled: the rows of the ranking metric over all takes, by statistic.
        by_take: the ranking metric by mount and repeat,
        before_by_take: and that of the baseline.
        floor: the largest noise floor among the takes; None where one of them has none, and of
            metrics that it isn't the floor of.
        coverage: the least share of valid poses [%],
        epochs: and the most world frames; None where one of the takes lacks it.
        failed: takes that could not be scored.
        invalid: takes that the gate refuses.
        status: `ok`, or why it isn't ranked: a status of rows, or one of words,
        reason: and why, in words.
    """

    bundle: Bundle
    suite: Suite
    key: BoardKey
    takes: Sequence[TakeRecord]
    before: Sequence[TakeRecord]
    row: Row | None = None
    pooled: dict[str, Row] = field(default_factory=dict)
    by_take: dict[tuple[int, int], Sampled] = field(default_factory=dict)
    before_by_take: dict[tuple[int, int], Sampled] = field(default_factory=dict)
    floor: float | None = None
    coverage: float | None = None
    epochs: float | None = None
    failed: int = 0
    invalid: int = 0
    status: str = "ok"
    reason: str = ""

    @property
    def run(self) -> str:
        return str(self.bundle.folder)

    @property
    def record(self) -> RunRecord:
        return self.bundle.record

    @property
    def cameras(self) -> tuple[int, int] | None:
        """How many cameras the condition covers, and of how many; None where nobody said."""
        occlusion = self.record.occlusion
        for condition in self.suite.conditions if occlusion else ():
            level = condition.of(self.suite.case(self.key.case)).occlude
            if condition.id == self.key.condition and occlusion is not None:
                covered = [] if level == UNCOVERED else occlusion.levels.get(level)
                return None if covered is None else (len(covered), len(occlusion.cameras))
        return None

    @property
    def identity(self) -> tuple[str, ...]:
        """What makes it a row: device, firmware, logger and version, prediction mode, lab."""
        device = self.record.device
        return (
            device.headset,
            device.firmware,
            device.logger,
            device.logger_version,
            device.prediction,
            self.record.lab,
        )


def is_change(suite: Suite, condition: str) -> bool:
    """Whether a condition is ranked by its change against the baseline."""
    return baseline_of(suite) not in (None, condition) and condition != DEFAULT


def baseline_of(suite: Suite) -> str | None:
    """The condition that the others are compared with, in suites that compare."""
    return suite.baseline if suite.compare == "paired" else None


def standings(bundle: Bundle, protocol: str) -> list[Standing]:
    """What a run says on each of its boards.

    Raises:
        DataError: it has no metrics yet, or none that the suite ranks by, they were changed, or its
            suite isn't that of its digest.
    """
    suite = _suite(bundle)
    reference, rank = bundle.record.references[0], suite.rank
    name = f"metrics/{protocol}.csv"
    path, text = bundle.folder / name, bundle.content(name)
    metric, numbers = re.escape(rank.metric), "|".join(sorted({*STATISTICS, rank.statistic}))
    ranking = rf"{metric},{rank.point},all,(?:{numbers})"
    # what could not be computed has neither point nor statistic
    others = (rf"{metric},,all,value", "coverage[.](?:valid|epochs)", f"floor[.]total,{rank.point}")
    rows = select_rows(path, text, reference=reference, variant="main", cells=(ranking, *others))
    if baseline_of(suite):
        rows += select_rows(
            path, text, reference=reference, variant="vs-baseline", cells=(ranking, others[0])
        )
    if not any(row.metric == rank.metric for row in rows):
        raise DataError(
            f"protocol {protocol} gives no {rank.metric} at the {rank.point} against {reference}, "
            f"by which {suite.label} ranks",
            file=path,
            fix="`vrbench report` and `compare` show what it gives",
        )
    by_case: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        by_case[row.case, row.condition].append(row)
    groups = _groups(bundle, suite, protocol)
    found = []
    for key, takes in groups.items():
        before: list[TakeRecord] = []
        if is_change(suite, key.condition):
            before = [
                take
                for other, group in groups.items()
                if (other.case, other.condition) == (key.case, baseline_of(suite))
                for take in group
            ]
        mine = by_case[key.case, key.condition]
        base = by_case[key.case, baseline_of(suite) or ""] if before else []
        found.append(_standing(bundle, suite, key, takes, before, mine, base))
    return found


def _suite(bundle: Bundle) -> Suite:
    suite, stated = bundle.record.resolved_suite(), bundle.record.suite_digest
    if suite.digest != stated:
        raise DataError(
            f"the suite's digest is {suite.digest[:12]}..., not {stated[:12]}...",
            file=bundle.folder / RECORD,
            field="suite_digest",
            fix="a suite that is changed gets a version of its own",
        )
    return suite


def _groups(bundle: Bundle, suite: Suite, protocol: str) -> dict[BoardKey, list[TakeRecord]]:
    """The ranked takes of a run by board: scored cases; calibrations where there are no others."""
    every = bundle.record.takes
    takes = [take for take in every if take.role == "scored"]
    groups: dict[BoardKey, list[TakeRecord]] = defaultdict(list)
    for take in takes or [take for take in every if take.role == "calibration"]:
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


def _standing(
    bundle: Bundle,
    suite: Suite,
    key: BoardKey,
    takes: Sequence[TakeRecord],
    before: Sequence[TakeRecord],
    rows: Sequence[Row],
    base: Sequence[Row],
) -> Standing:
    rank = suite.rank
    main = [row for row in rows if row.variant == "main"]
    ranking = [row for row in main if row.metric == rank.metric]
    change = is_change(suite, key.condition)
    pooled = {r.statistic: r for r in ranking if _is_pooled(r, takes)}
    if change:
        changes = [r for r in rows if r.variant == "vs-baseline" and r.repeat == "all"]
        row = next((r for r in changes if r.statistic == rank.statistic), None)
    else:
        row = pooled.get(rank.statistic)
    coverage = _extreme(min, main, "coverage.valid")
    epochs = _extreme(max, main, "coverage.epochs")
    troubled = {
        (r.mount, r.repeat): r.status
        for r in ranking
        if r.status in ("failed", "invalid") and "all" not in (r.mount, r.repeat)
    }
    status, reason = _judged(suite, takes, [*main, *base], row, coverage, epochs, change=change)
    if status == "ok" and (gone := _gone(bundle)):
        status, reason = "takes missing", f"{gone} of its takes aren't there to be evaluated again"
    return Standing(
        bundle=bundle,
        suite=suite,
        key=key,
        takes=takes,
        before=before,
        row=row if status not in ("failed", "invalid") else None,
        pooled=pooled if status not in ("failed", "invalid") else {},
        by_take=_by_take(ranking, rank.statistic),
        before_by_take=_by_take([r for r in base if r.metric == rank.metric], rank.statistic),
        floor=_extreme(max, main, "floor.total") if rank.metric.startswith(FLOORED) else None,
        coverage=coverage,
        epochs=epochs,
        failed=sum(status == "failed" for status in troubled.values()),
        invalid=sum(status == "invalid" for status in troubled.values()),
        status=status,
        reason=reason,
    )


def _gone(bundle: Bundle) -> int:
    """How many takes that were recorded aren't in the folder."""
    folder = bundle.folder / "takes"
    there = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    recorded = [take for take in bundle.record.takes if take.status == "ok"]
    return sum(Path(take.file).name not in there for take in recorded)


def _is_pooled(row: Row, takes: Sequence[TakeRecord]) -> bool:
    """Whether a row is of all takes together, or of the only one."""
    if (row.segment, row.band) != ("all", "all"):
        return False
    if len(takes) > 1:
        return (row.mount, row.repeat) == ("all", "all")
    return (row.mount, row.repeat) == (str(takes[0].mount), str(takes[0].repeat))


def _by_take(rows: Iterable[Row], statistic: str) -> dict[tuple[int, int], Sampled]:
    return {
        (int(row.mount), int(row.repeat)): (row.value, row.samples)
        for row in rows
        if row.value is not None
        and row.variant == "main"
        and (row.statistic, row.segment) == (statistic, "all")
        and "all" not in (row.mount, row.repeat)
    }


def _judged(
    suite: Suite,
    takes: Sequence[TakeRecord],
    rows: Sequence[Row],
    chosen: Row | None,
    coverage: float | None,
    epochs: float | None,
    *,
    change: bool,
) -> tuple[str, str]:
    """`ok`, or why a run isn't ranked; the gravest reason comes first.

    Whether its interval speaks for more than its takes is judged of all its sittings together.
    """
    troubled = [r for r in rows if r.metric == suite.rank.metric]
    troubled = [row for row in troubled if row.status in ("failed", "invalid")]
    if troubled:
        worst = min(troubled, key=lambda row: STATUSES.index(row.status))
        return worst.status, worst.reason
    if chosen is None or chosen.value is None:
        what = "the change against the baseline" if change else suite.rank.metric
        if not change and suite.rank.statistic not in POOLED:
            return "failed", f"the {suite.rank.statistic} of several takes isn't computed"
        if chosen is None or chosen.status == "ok":
            return "failed", f"{what} was not computed"
        return chosen.status, chosen.reason
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
    return "ok", ""


def _extreme(
    choose: Callable[[Iterable[float]], float], rows: Sequence[Row], metric: str
) -> float | None:
    """The least or the largest of a metric among the takes; None where one of them has none."""
    found = [r.value for r in rows if r.metric == metric and r.repeat != "all"]
    known = [value for value in found if value is not None]
    return choose(known) if known and len(known) == len(found) else None
