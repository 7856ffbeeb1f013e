"""What a leaderboard consists of: boards, and entries on them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from vrbench.errors import VrbenchError

# What the table of the paper prints of each device.
STATISTICS = ("rmse", "mean", "std", "max")
# The metrics that `floor.total` is the floor of: what trembles or turns has another one.
FLOORED = "ape.translation."


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
    """One device on a board: one row.

    Attributes:
        rank: the best place it may have, from 1; None for an entry that is listed but not ranked.
        last_rank: the worst place it may have. Entries that can't be told apart have places in
            common.
        ranked_among: the labs whose entries were ranked together with it.
        value: the ranking number; None where there is none.
        low: lower end of its 95 % interval,
        high: and its upper end.
        scope: what the interval speaks for: `take`, `mount`, `sitting`; empty without one.
        statistics: rmse, mean, std and max of the ranking metric, as far as they are known; for a
            board of changes those of the condition itself.
        floor: the largest noise floor among the takes, in the same unit; None where it isn't known,
            as of whatever isn't an absolute error of translation.
        takes: takes the number rests on.
        mounts: mounts among them,
        sittings: and visits to the lab.
        failed: takes of the case that could not be scored.
        invalid: takes of the case that the gate refuses.
        coverage: least share of valid poses among the takes [%]; None where not measured.
        epochs: most world frames in one take; None where not measured.
        cameras: how many cameras were covered, and how many there are; None where nobody said.
        status: `ok`, or why the entry isn't ranked,
        reason: in words.
        runs: the bundles it comes from; for a published entry where it was printed.
        source: `measured`, or `published`: printed by others, not scored by vrbench.
    """

    device: str
    firmware: str
    logger: str
    logger_version: str
    prediction: str
    lab: str
    value: float | None
    unit: str
    rank: int | None = None
    last_rank: int | None = None
    ranked_among: Sequence[str] = ()
    low: float | None = None
    high: float | None = None
    scope: str = ""
    statistics: Mapping[str, float | None] = field(default_factory=dict)
    floor: float | None = None
    takes: int = 0
    mounts: int = 0
    sittings: int = 0
    failed: int = 0
    invalid: int = 0
    coverage: float | None = None
    epochs: int | None = None
    cameras: tuple[int, int] | None = None
    status: str = "ok"
    reason: str = ""
    runs: Sequence[str] = ()
    source: Literal["measured", "published"] = "measured"

    @property
    def places(self) -> str:
        """Its rank as a table prints it: `2`, `1-3` where it can't be told apart.

        `-` where it has none; `pub.` where it was printed by others.
        """
        if self.rank is None:
            return "pub." if self.source == "published" else "-"
        return str(self.rank) if self.rank == self.last_rank else f"{self.rank}-{self.last_rank}"

    @property
    def name(self) -> str:
        """The device; of a published entry also what was printed of it."""
        return f"{self.device} ({self.runs[0]})" if self.source == "published" else self.device

    @property
    def identity(self) -> tuple[str, ...]:
        """What makes it another device: device, firmware, logger and version, prediction mode."""
        return (self.device, self.firmware, self.logger, self.logger_version, self.prediction)


@dataclass(frozen=True, slots=True)
class Board:
    """Entries that can be compared: the ranked, then the unranked, each best first; published last.

    Attributes:
        metric: what is ranked, in words.
        change: whether it is the change against each device's own baseline.
    """

    key: BoardKey
    metric: str
    entries: Sequence[Entry]
    change: bool = False

    @property
    def title(self) -> str:
        """The board's suite, case, condition, motion and speed, in words."""
        key = self.key
        what = "simulated devices" if key.simulated else "recorded devices"
        condition = "" if key.condition == "default" else f" ({key.condition})"
        return f"{key.suite}, {key.case}{condition} by {key.motion}, speed {key.speed:g}, of {what}"

    @property
    def unit(self) -> str:
        """The unit of its numbers; empty where there are none."""
        return next((e.unit for e in self.entries if e.unit and e.source == "measured"), "")


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A run that stands on no board, and why."""

    run: str
    error: VrbenchError


@dataclass(frozen=True, slots=True)
class Leaderboard:
    """All boards of some runs, and the runs that stand on none."""

    boards: Sequence[Board]
    left_out: Sequence[LeftOut] = ()


def notes(board: Board) -> Iterator[str]:
    """What a table has no room for: why entries have no rank, what failed, who is ranked apart."""
    for entry in board.entries:
        who = f"{entry.device} of {entry.lab}"
        if entry.source == "published":
            continue
        if entry.rank is None:
            yield f"{who} has no rank: {entry.status}: {entry.reason}"
        elif entry.reason:
            yield f"{who}: {entry.reason}"
        if entry.failed or entry.invalid:
            yield f"{who}: {entry.failed} takes failed, {entry.invalid} invalid"
    apart = list(dict.fromkeys(tuple(e.ranked_among) for e in board.entries if e.ranked_among))
    if len(apart) > 1:
        named = "; ".join(", ".join(labs) for labs in apart)
        yield f"ranked apart, because their labs have no reference device in common: {named}"
    printed = [entry for entry in board.entries if entry.source == "published"]
    for reason in dict.fromkeys(entry.reason for entry in printed):
        named = ", ".join(entry.name for entry in printed if entry.reason == reason)
        yield f"pub.: {named}: {reason}"
