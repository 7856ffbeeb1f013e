"""How the number of a device scatters: by mount, by sitting, along the motion."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import reduce

import numpy as np

from vrbench.geometry import Floats, Ints
from vrbench.results.numbers import Sampled
from vrbench.results.record import TakeRecord
from vrbench.results.selection import select_bins
from vrbench.results.standing import Standing
from vrbench.statistics.paired import Phases
from vrbench.statistics.ranks import Measured

# What errors by phase are kept of.
BY_PHASE = ("ape.translation.aligned", "ape.rotation.aligned")
NO_BINS: tuple[Ints, Floats] = np.array([], dtype=np.int64), np.array([])


def measured(sittings: Sequence[Standing], *, floor: float | None = None) -> Measured:
    """The ranking number of a row's runs, one a sitting, and its scatter.

    Args:
        sittings: the runs.
        floor: the noise floor, in the number's unit.

    Raises:
        DataError: a table of errors by phase was changed, or can't be read.
    """
    change = bool(sittings[0].before)
    here = _clusters(sittings, [s.numbers.by_take for s in sittings])
    statistic = sittings[0].suite.rank.statistic
    size = _together([v for values in here.values() for v in values], statistic)
    value, (bins, by_bin) = size, _bins(sittings, [s.takes for s in sittings])
    numbers = {cluster: _together(values, statistic) for cluster, values in here.items()}
    if change:
        before = _clusters(sittings, [s.base.by_take if s.base else {} for s in sittings])
        value -= _together([v for values in before.values() for v in values], statistic)
        numbers = {
            cluster: number - _together(before[cluster], statistic)
            for cluster, number in numbers.items()
            if cluster in before
        }
        others, by_other = _bins(sittings, [s.before for s in sittings])
        bins, mine, theirs = np.intersect1d(bins, others, assume_unique=True, return_indices=True)
        by_bin = by_bin[mine] - by_other[theirs]
    return Measured(
        value=value,
        clusters=np.array(list(numbers.values())),
        bin=bins,
        by_bin=by_bin,
        size=size,
        floor=floor or 0.0,
    )


def _clusters(
    sittings: Sequence[Standing], by_take: Sequence[Mapping[tuple[int, int], Sampled]]
) -> dict[str, list[Sampled]]:
    """The takes' numbers by sitting; by mount, where there is one sitting."""
    clusters: dict[str, list[Sampled]] = defaultdict(list)
    for standing, numbers in zip(sittings, by_take, strict=True):
        for (mount, _), sampled in numbers.items():
            name = standing.record.sitting if len(sittings) > 1 else str(mount)
            clusters[name].append(sampled)
    return clusters


def _together(numbers: Iterable[Sampled], statistic: str) -> float:
    """The number of several takes together: rmse over all samples, else the mean of the takes'."""
    pairs = list(numbers)
    if not pairs:
        return 0.0
    if statistic == "rmse":
        squares = sum(number**2 * max(samples, 1) for number, samples in pairs)
        return math.sqrt(squares / sum(max(samples, 1) for _, samples in pairs))
    return sum(number for number, _ in pairs) / len(pairs)


def _bins(
    sittings: Sequence[Standing], takes: Sequence[Sequence[TakeRecord]]
) -> tuple[Ints, Floats]:
    """The rmse as a mean over the bins of phase that all takes have; none where not known.

    To first order, the rmse over some bins is the mean over them of (square / rmse + rmse) / 2.
    """
    every: list[Phases] = []
    for standing, mine in zip(sittings, takes, strict=True):
        known = phases(standing, mine)
        if not known:
            return NO_BINS
        every += known
    common = every[0].bin
    squares = [one.mean_square for one in every]
    if not all(np.array_equal(one.bin, common) for one in every):
        common = reduce(np.intersect1d, [one.bin for one in every])
        squares = [one.mean_square[np.isin(one.bin, common)] for one in every]
    square = np.mean(squares, axis=0)
    rmse = float(np.sqrt(np.mean(square))) if len(common) else 0.0
    return (common, (square / rmse + rmse) / 2) if rmse > 0.0 else NO_BINS


def phases(standing: Standing, takes: Sequence[TakeRecord]) -> list[Phases]:
    """The errors of takes by phase; none where they aren't known of the ranking metric.

    Raises:
        DataError: the table was changed, or can't be read.
    """
    rank, record = standing.suite.rank, standing.record
    name = f"metrics/{standing.key.protocol}.phase.csv"
    if rank.metric not in BY_PHASE or rank.statistic != "rmse" or name not in record.files:
        return []
    found = select_bins(
        standing.bundle.folder / name,
        standing.bundle.content(name),
        takes,
        reference=standing.key.reference,
        metric=rank.metric,
        point=rank.point,
    )
    if len(found) < len(takes):
        return []
    return [
        Phases(bins, np.sqrt(square), square, mount=str(mount), sitting=record.sitting)
        for (mount, _), (bins, square) in found.items()
    ]
