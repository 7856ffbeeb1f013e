"""What one run says of its device on one board, and whether that may be ranked."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from vrbench.config.case import UNCOVERED
from vrbench.config.schedule import DEFAULT
from vrbench.config.suite import Suite
from vrbench.errors import DataError
from vrbench.results.board import BoardKey
from vrbench.results.bundle import Bundle
from vrbench.results.numbers import Numbers, read_numbers
from vrbench.results.record import RECORD, RunRecord, TakeRecord
from vrbench.results.selection import MetricTable
from vrbench.results.tables import STATUSES, Row


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
        numbers: what the table says of the takes,
        base: and, for a board of changes, of those of the baseline.
        status: `ok`, or why it isn't ranked: a status of rows, or one of words,
        reason: and why, in words.
    """

    bundle: Bundle
    suite: Suite
    key: BoardKey
    takes: Sequence[TakeRecord]
    before: Sequence[TakeRecord]
    row: Row | None
    numbers: Numbers
    base: Numbers | None
    status: str
    reason: str

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
        DataError: it has no metrics yet, or none that the suite ranks by, they were
            changed, or its suite isn't that of its digest.
    """
    suite, record = _suite(bundle), bundle.record
    name = f"metrics/{protocol}.csv"
    path = bundle.folder / name
    table = MetricTable(path, bundle.content(name))
    groups = _groups(bundle, suite, protocol)
    found: dict[BoardKey, Numbers] = {}
    for key, takes in groups.items():
        change = is_change(suite, key.condition)
        found[key] = read_numbers(table, key, suite.rank, takes, change=change)
    if not any(numbers.ranking for numbers in found.values()):
        rank = suite.rank
        raise DataError(
            f"protocol {protocol} gives no {rank.metric} at the {rank.point} against "
            f"{record.references[0]}, by which {suite.label} ranks",
            file=path,
            fix="`vrbench report` and `compare` show what it gives",
        )
    baselines = {key.case: key for key in groups if key.condition == baseline_of(suite)}
    return [_standing(bundle, suite, key, groups, found, baselines.get(key.case)) for key in groups]


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
    groups: Mapping[BoardKey, Sequence[TakeRecord]],
    found: Mapping[BoardKey, Numbers],
    baseline: BoardKey | None,
) -> Standing:
    numbers, takes = found[key], groups[key]
    change = is_change(suite, key.condition)
    base = found[baseline] if change and baseline else None
    row = numbers.change if change else numbers.pooled.get(suite.rank.statistic)
    status, reason = _judged(suite, takes, numbers, base, row, change=change)
    if status == "ok" and (gone := _gone(bundle)):
        status, reason = "takes missing", f"{gone} of its takes aren't there to be evaluated again"
    return Standing(
        bundle=bundle,
        suite=suite,
        key=key,
        takes=takes,
        before=groups[baseline] if change and baseline else (),
        row=row if status not in ("failed", "invalid") else None,
        numbers=numbers,
        base=base,
        status=status,
        reason=reason,
    )


def _gone(bundle: Bundle) -> int:
    """How many takes that were recorded aren't in the folder."""
    folder = bundle.folder / "takes"
    there = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    recorded = [
        take.file.removeprefix("takes/") for take in bundle.record.takes if take.status == "ok"
    ]
    return sum(name not in there for name in recorded)


def _judged(
    suite: Suite,
    takes: Sequence[TakeRecord],
    numbers: Numbers,
    base: Numbers | None,
    chosen: Row | None,
    *,
    change: bool,
) -> tuple[str, str]:
    """`ok`, or why a run isn't ranked; the gravest reason comes first.

    Whether its interval speaks for more than its takes is judged of all its sittings together.
    """
    rows = [*numbers.ranking, *(base.ranking if base else ())]
    troubled = [row for row in rows if row.status in ("failed", "invalid")]
    if troubled:
        worst = min(troubled, key=lambda row: STATUSES.index(row.status))
        return worst.status, worst.reason
    what = "the change against the baseline" if change else suite.rank.metric
    if None in numbers.takes.values():
        return "failed", f"{what} was not computed of every take"
    if chosen is None or (chosen.value is None and chosen.status == "ok"):
        return "failed", f"{what} was not computed"
    if chosen.status != "ok":
        return chosen.status, chosen.reason
    done = min(take.fraction for take in takes)
    if done < 1.0:
        return "not completed", f"the robot did {done * 100:.3g} % of the motion"
    if numbers.coverage is None:
        return "no coverage", "coverage was not computed"
    if numbers.coverage < suite.rank.min_coverage * 100:
        return "low coverage", f"the suite asks for {suite.rank.min_coverage:.0%} valid poses"
    if numbers.epochs is not None and numbers.epochs > 1:
        return "recentred", "each world frame of a take is aligned apart, which flatters it"
    return "ok", ""
