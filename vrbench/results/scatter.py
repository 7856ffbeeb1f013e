"""How the number of a device scatters: by mount, by sitting, along the motion."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import reduce

import numpy as np

from vrbench.results.numbers import Sampled
from vrbench.results.record import TakeRecord
from vrbench.results.selection import select_bins
from vrbench.results.standing import Standing
from vrbench.statistics.paired import Phases
from vrbench.statistics.ranks import Measured

# What errors by phase are kept of.
BY_PHASE = ("ape.translation.aligned", "ape.rotation.aligned")


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
    value, bins = size, _bins(sittings, [s.takes for s in sittings])
    numbers = {cluster: _together(values, statistic) for cluster, values in here.items()}
    if change:
        before = _clusters(sittings, [s.base.by_take if s.base else {} for s in sittings])
        value -= _together([v for values in before.values() for v in values], statistic)
        numbers = {
            cluster: number - _together(before[cluster], statistic)
            for cluster, number in numbers.items()
            if cluster in before
        }
        bins = _less(bins, _bins(sittings, [s.before for s in sittings]))
    bin_numbers = np.array(sorted(bins), dtype=np.int64)
    return Measured(
        value=value,
        clusters=np.array(list(numbers.values())),
        bin=bin_numbers,
        by_bin=np.array([bins[b] for b in bin_numbers.tolist()]),
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
    pairs = np.array(list(numbers), dtype=float)
    if not len(pairs):
        return 0.0
    if statistic == "rmse":
        return float(np.sqrt(np.average(pairs[:, 0] ** 2, weights=np.maximum(pairs[:, 1], 1.0))))
    return float(pairs[:, 0].mean())


def _bins(sittings: Sequence[Standing], takes: Sequence[Sequence[TakeRecord]]) -> dict[int, float]:
    """The rmse as a mean over the bins of phase that all takes have; empty where not known.

    To first order, the rmse over some bins is the mean over them of (square / rmse + rmse) / 2.
    """
    every: list[Phases] = []
    for standing, mine in zip(sittings, takes, strict=True):
        known = phases(standing, mine)
        if not known:
            return {}
        every += known
    common = every[0].bin
    squares = [one.mean_square for one in every]
    if not all(np.array_equal(one.bin, common) for one in every):
        common = reduce(np.intersect1d, [one.bin for one in every])
        squares = [one.mean_square[np.isin(one.bin, common)] for one in every]
    square = np.mean(squares, axis=0)
    rmse = float(np.sqrt(np.mean(square))) if len(common) else 0.0
    if rmse == 0.0:
        return {}
    return dict(zip(common.tolist(), ((square / rmse + rmse) / 2).tolist(), strict=True))


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


def _less(first: Mapping[int, float], second: Mapping[int, float]) -> dict[int, float]:
    return {b: first[b] - second[b] for b in first.keys() & second.keys()}
