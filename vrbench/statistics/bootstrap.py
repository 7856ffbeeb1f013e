"""Hierarchical bootstrap: sitting > mount > repeat > block of correlated samples."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from vrbench.errors import EstimationError
from vrbench.estimation.blocks import block_length
from vrbench.geometry import Floats, Ints

Statistic = Literal["rmse", "mean"]
# From the number of replicates to the errors of each series in each of them (replicates, n).
Redraw = Callable[[np.random.Generator, int], Sequence[Floats]]
# Indices of repeats by sitting, and in each of them by mount.
Groups = list[list[list[int]]]
Member = TypeVar("Member")

LEVEL = 0.95
REPLICATES = 1000
MIN_REPEATS = 3
# With fewer blocks to draw from, a resampled take would hardly differ from the take.
MIN_BLOCKS = 8


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """The errors of one repeat, and where it belongs.

    Attributes:
        errors: one error a sample (n,), evenly in time, in any unit.
        mount: the fixing of the headset it was recorded in.
        sitting: the visit to the lab it was recorded in.
        block: samples that depend on each other; None where only the errors can tell.
    """

    errors: Floats
    mount: str = ""
    sitting: str = ""
    block: int | None = None


@dataclass(frozen=True, slots=True)
class Interval:
    """An interval of confidence.

    Attributes:
        low: its lower end, in the errors' unit.
        high: its upper end.
        scope: `take`, `mount` or `sitting`: over what the recordings allow it to speak.
    """

    low: float
    high: float
    scope: str


def bootstrap(
    series: Sequence[Series],
    rng: np.random.Generator,
    *,
    statistic: Statistic = "rmse",
    level: float = LEVEL,
    replicates: int = REPLICATES,
    redraw: Redraw | None = None,
) -> Interval:
    """The expanded percentile interval of the pooled rmse or mean.

    In each replicate sittings are drawn with replacement, in each of them mounts, in each of them
    repeats, in each of them blocks of samples (circular, Politis and Romano 1992), as long as the
    data ask for (Politis and White 2004). A level with one member stays as it is.

    Args:
        series: the repeats.
        rng: where the randomness comes from.
        statistic: `rmse` or `mean`.
        level: probability that the interval is to hold.
        replicates: how often to draw.
        redraw: gives the errors of all series under so many draws of what they rest on, such as X;
            None to take them as they are.

    Raises:
        EstimationError: no series, or one without samples.
    """
    _require_samples(series)
    lengths = [_block_length(s, statistic) for s in series]
    errors = [s.errors[None] for s in series] if redraw is None else redraw(rng, replicates)
    sums = [running_sums(_powers(e, statistic)) for e in errors]
    places = [(s.sitting, s.mount) for s in series]
    total, count = np.zeros(replicates), np.zeros(replicates)
    groups = nested(places)
    drawn = [draw_members(groups, rng) for _ in range(replicates)]
    for place in range(max(map(len, drawn))):
        member = np.array([d[place] if place < len(d) else -1 for d in drawn])
        for i, length in enumerate(lengths):
            replicate = np.flatnonzero(member == i)
            total[replicate] += draw_blocks(sums[i], replicate, length, rng)
            count[replicate] += len(series[i].errors)
    found = total / count
    if statistic == "rmse":
        found = np.sqrt(found)
    blocks = sum(len(s.errors) // length for s, length in zip(series, lengths, strict=True))
    low, high = expanded_percentiles(found, level, independent_members(places, blocks))
    return Interval(low, high, scope_of(places))


def expanded_percentiles(replicates: Floats, level: float, members: int) -> tuple[float, float]:
    """The percentile interval of bootstrap replicates, widened for few members.

    A percentile interval is as much too narrow as a normal interval with the population's standard
    deviation in place of Student's. Hesterberg (What Teachers Should Know About the Bootstrap,
    2015) takes percentiles so much further out: at `Phi(-sqrt(n / (n - 1)) t)`. With two or three
    members those are the least and the largest replicate.

    Args:
        replicates: the statistic in each replicate (b,).
        level: probability that the interval is to hold.
        members: how many independent members n were drawn from.
    """
    from scipy.special import ndtr, stdtrit

    n = max(members, 2)
    tail = 100 * float(ndtr(-np.sqrt(n / (n - 1)) * stdtrit(n - 1, (1 + level) / 2)))
    low, high = np.percentile(replicates, (tail, 100 - tail))
    return float(low), float(high)


def independent_members(places: Sequence[tuple[Hashable, Hashable]], blocks: int) -> int:
    """How many there are of the outermost level with more than one: sitting, mount, repeat, block.

    Args:
        places: sitting and mount of each repeat.
        blocks: of samples, in all repeats together.
    """
    levels = len({sitting for sitting, _ in places}), len(set(places)), len(places)
    return next((n for n in levels if n > 1), blocks)


def scope_of(places: Sequence[tuple[Hashable, Hashable]]) -> str:
    """Over what an interval speaks, given sitting and mount of each repeat.

    One mount, or fewer than three repeats in some mount, speak for their takes only.
    """
    repeats = [places.count(place) for place in set(places)]
    if len(repeats) < 2 or min(repeats) < MIN_REPEATS:
        return "take"
    return "sitting" if len({sitting for sitting, _ in places}) > 1 else "mount"


def nested(places: Sequence[tuple[Hashable, Hashable]]) -> Groups:
    """The repeats, given sitting and mount of each."""
    groups: dict[Hashable, dict[Hashable, list[int]]] = {}
    for i, (sitting, mount) in enumerate(places):
        groups.setdefault(sitting, {}).setdefault(mount, []).append(i)
    return [list(mounts.values()) for mounts in groups.values()]


def draw_members(groups: Groups, rng: np.random.Generator) -> list[int]:
    """Repeats drawn with replacement, level by level.

    Args:
        groups: the repeats, `nested`.
        rng: where the randomness comes from.
    """
    return [
        repeat
        for sitting in _drawn(groups, rng)
        for mount in _drawn(sitting, rng)
        for repeat in _drawn(mount, rng)
    ]


def _drawn(members: list[Member], rng: np.random.Generator) -> list[Member]:
    if len(members) == 1:
        return members
    return [members[i] for i in rng.integers(len(members), size=len(members)).tolist()]


def running_sums(values: Floats) -> Floats:
    """Sums (m, 2 n + 1) of the first k values of series (m, n) that are followed by themselves."""
    n = values.shape[1]
    sums = np.zeros((len(values), 2 * n + 1))
    np.cumsum(values, axis=1, out=sums[:, 1 : n + 1])
    np.add(sums[:, 1 : n + 1], sums[:, n, None], out=sums[:, n + 1 :])
    return sums


def draw_blocks(sums: Floats, replicate: Ints, length: int, rng: np.random.Generator) -> Floats:
    """Sums (r,) over a series resampled for each replicate (r,), from its `running_sums`.

    Args:
        sums: one row for all replicates, or one for each.
        replicate: which replicates to draw for (r,).
        length: of a block, in samples.
        rng: where the randomness comes from.
    """
    n = sums.shape[1] // 2
    blocks = -(-n // length)
    starts = rng.integers(n, size=(len(replicate), blocks))
    ends = starts + length
    ends[:, -1] -= blocks * length - n
    row = replicate[:, None] if len(sums) > 1 else 0
    drawn: Floats = np.sum(sums[row, ends] - sums[row, starts], axis=1)
    return drawn


def _block_length(series: Series, statistic: Statistic) -> int:
    asked = series.block or block_length(_powers(series.errors, statistic))
    return max(1, min(asked, len(series.errors) // MIN_BLOCKS))


def _powers(errors: Floats, statistic: Statistic) -> Floats:
    return errors * errors if statistic == "rmse" else errors


def _require_samples(series: Sequence[Series]) -> None:
    if not series or any(len(s.errors) == 0 for s in series):
        raise EstimationError("an interval needs samples of every repeat")
