"""Two runs, paired by phase of the motion: how far they differ, and whether that can be said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from vrbench.errors import ConfigError, EstimationError
from vrbench.results.board import BoardKey
from vrbench.results.bundle import Bundle
from vrbench.results.scatter import measured, phases
from vrbench.results.standing import Standing, is_change, standings
from vrbench.statistics.bootstrap import scope_of
from vrbench.statistics.paired import paired_difference
from vrbench.statistics.ranks import separation

TOO_FEW = "these takes only: it takes two mounts of three repeats each in both runs"
# Of the draws behind an interval of takes.
SEED = 0
Verdict = Literal["separable", "not separable", "can't be said"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two runs under one condition.

    Attributes:
        key: what both share.
        metric: what is compared, in words.
        unit: of all numbers.
        first: the number of the first run; None where it has none,
        second: and of the second.
        difference: the first less the second,
        low: lower end of its 95 % interval,
        high: and its upper end.
        paired: whether the motion's phases were paired.
        scope: what the interval speaks for: `take`, `mount`, `sitting`; empty without one.
        verdict: whether the two can be told apart,
        reason: and why not, or which is better.
    """

    key: BoardKey
    metric: str
    unit: str
    first: float | None
    second: float | None
    difference: float | None = None
    low: float | None = None
    high: float | None = None
    paired: bool = False
    scope: str = ""
    verdict: Verdict = "can't be said"
    reason: str = ""


def compare(first: Bundle, second: Bundle, protocol: str) -> list[Comparison]:
    """What two runs have in common, case by case and condition by condition.

    Raises:
        ConfigError: they are one run, or have nothing in common: what differs.
        DataError: a run has no metrics yet, or they were changed.
    """
    if first.folder.resolve() == second.folder.resolve():
        raise ConfigError("a run is compared with itself", file=first.folder)
    mine = {standing.key: standing for standing in standings(first, protocol)}
    theirs = {standing.key: standing for standing in standings(second, protocol)}
    shared = [key for key in mine if key in theirs]
    if not shared:
        raise ConfigError(
            f"{first.folder} and {second.folder} have nothing in common",
            fix=_what_differs(list(mine), list(theirs)),
        )
    return [_compared(mine[key], theirs[key]) for key in shared]


def _what_differs(first: Sequence[BoardKey], second: Sequence[BoardKey]) -> str:
    fields = ("suite", "suite_digest", "simulated", "case", "condition", "motion", "motion_digest")
    for field in (*fields, "reference", "speed"):
        mine = sorted({str(getattr(key, field)) for key in first})
        theirs = sorted({str(getattr(key, field)) for key in second})
        if not set(mine) & set(theirs):
            return f"{field}: {', '.join(mine) or 'none'} and {', '.join(theirs) or 'none'}"
    return "no case under one condition with one motion"


def _compared(first: Standing, second: Standing) -> Comparison:
    rank, rows = first.suite.rank, (first.row, second.row)
    metric = f"{rank.metric} {rank.statistic} at the {rank.point}"
    if is_change(first.suite, first.key.condition):
        metric = f"change of {metric}"
    values = [None if row is None else row.value for row in rows]
    plain = Comparison(
        key=first.key,
        metric=metric,
        unit=next((row.unit for row in rows if row), ""),
        first=values[0],
        second=values[1],
    )
    if values[0] is None or values[1] is None:
        return replace(plain, reason=_unsaid(first, second))
    plain = replace(plain, difference=values[0] - values[1])
    if "take" in (_scope(first), _scope(second)):
        return _of_takes(plain, first, second)
    found = separation(
        measured([first], floor=first.numbers.floor), measured([second], floor=second.numbers.floor)
    )
    judged = replace(plain, low=found.low, high=found.high, paired=found.paired, scope="mount")
    if why := _unsaid(first, second):
        return replace(judged, reason=why)
    if not found.told:
        chance = found.low <= 0.0 <= found.high
        why = "so much may be chance" if chance else "both lie below the noise floor"
        return replace(judged, verdict="not separable", reason=why)
    better = (first if found.value < 0 else second).run
    return replace(judged, verdict="separable", reason=f"{better} errs less")


def _of_takes(plain: Comparison, first: Standing, second: Standing) -> Comparison:
    """Too few takes to say anything of the devices; how far these takes differ, if it's known."""
    why = _unsaid(first, second) or TOO_FEW
    both = phases(first, first.takes), phases(second, second.takes)
    if not all(both) or first.before or second.before:
        return replace(plain, reason=why)
    try:
        found = paired_difference(*both, np.random.default_rng(SEED))
    except EstimationError as error:
        return replace(plain, reason=f"{why}; {error}")
    return replace(
        plain, low=found.low, high=found.high, paired=True, scope=found.scope, reason=why
    )


def _scope(standing: Standing) -> str:
    return scope_of([(standing.record.sitting, take.mount) for take in standing.takes])


def _unsaid(first: Standing, second: Standing) -> str:
    """Why nothing follows for the devices; empty where something does."""
    for standing in (first, second):
        if standing.status != "ok":
            return f"{standing.run} is {standing.status}: {standing.reason}"
    labs = first.record.lab, second.record.lab
    if labs[0] != labs[1] and first.identity[:-1] != second.identity[:-1]:
        return (
            f"{labs[0]} and {labs[1]} may differ as much themselves; a leaderboard can say, "
            "with a device that both ran"
        )
    return ""
