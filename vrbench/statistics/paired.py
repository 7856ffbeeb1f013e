"""Paired difference: whether two runs of the same motion differ by more than chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vrbench.errors import EstimationError
from vrbench.estimation.blocks import block_length
from vrbench.geometry import Floats, Ints
from vrbench.statistics.bootstrap import (
    LEVEL,
    MIN_BLOCKS,
    REPLICATES,
    draw_members,
    expanded_percentiles,
    independent_members,
    nested,
    scope_of,
)

BIN_S = 1.0
MIN_BINS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Phases:
    """The errors of one repeat, by bins of the motion's own time.

    Attributes:
        bin: numbers of the bins (k,), increasing.
        mean: mean error in each bin (k,).
        mean_square: mean square error in each bin (k,), in the square of its unit.
        mount: the fixing of the headset it was recorded in.
        sitting: the visit to the lab it was recorded in.
    """

    bin: Ints
    mean: Floats
    mean_square: Floats
    mount: str = ""
    sitting: str = ""


@dataclass(frozen=True, slots=True)
class Difference:
    """How much larger the error of the first run is than that of the second.

    Attributes:
        value: difference of the rmse over the bins both have, in the errors' unit.
        low: lower end of its interval.
        high: upper end.
        scope: the narrower of both runs' scopes: `take`, `mount`, `sitting`.
        bins: how many bins both have.
        separable: whether the interval leaves nought out and speaks for more than takes.
        reason: why not, where it isn't.
    """

    value: float
    low: float
    high: float
    scope: str
    bins: int
    separable: bool
    reason: str = ""


def by_phase(
    phase_s: Floats, error: Floats, *, mount: str = "", sitting: str = "", bin_s: float = BIN_S
) -> Phases:
    """Errors (n,) at phases (n,) [s] of the motion, in bins.

    The phase is the time since the motion's start, on the reference's clock, so that the same bin
    of two runs is the same stretch of path.
    """
    number = np.floor(phase_s / bin_s).astype(np.int64)
    bins, index, count = np.unique(number, return_inverse=True, return_counts=True)
    mean = np.bincount(index, weights=error) / count
    mean_square = np.bincount(index, weights=error * error) / count
    return Phases(bins, mean, mean_square, mount, sitting)


def paired_difference(
    first: Sequence[Phases],
    second: Sequence[Phases],
    rng: np.random.Generator,
    *,
    level: float = LEVEL,
    replicates: int = REPLICATES,
) -> Difference:
    """Rmse of the first run less that of the second, over the bins that all repeats of both have.

    In each replicate the clusters of each run are drawn with replacement (sitting > mount >
    repeat), and blocks of bins, the same of both: what is hard about a stretch of the motion is so
    for both, and cancels.

    Args:
        first: the repeats of one run.
        second: the repeats of the other.
        rng: where the randomness comes from.
        level: probability that the interval is to hold.
        replicates: how often to draw.

    Raises:
        EstimationError: fewer than `MIN_BINS` bins that all repeats have.
    """
    common = _common([*first, *second])
    runs = [np.array([_rows(p, common) for p in run]) for run in (first, second)]
    places = [[(p.sitting, p.mount) for p in run] for run in (first, second)]
    groups = [nested(place) for place in places]
    per_bin = runs[0].mean(axis=0) - runs[1].mean(axis=0)
    n = len(common)
    length = max(1, min(block_length(per_bin), n // MIN_BLOCKS))
    blocks = -(-n // length)
    found = np.empty(replicates)
    for k in range(replicates):
        starts = rng.integers(n, size=blocks)
        drawn = ((starts[:, None] + np.arange(length)).ravel()[:n]) % n
        a, b = (
            _rmse(run[draw_members(group, rng)][:, drawn])
            for run, group in zip(runs, groups, strict=True)
        )
        found[k] = a - b
    members = min(independent_members(place, blocks) for place in places)
    low, high = expanded_percentiles(found, level, members)
    scope = min((scope_of(place) for place in places), key=["take", "mount", "sitting"].index)
    reason = ""
    if low <= 0.0 <= high:
        reason = "the interval holds nought"
    elif scope == "take":
        reason = "one mount, or fewer than three repeats, speak for their takes only"
    value = _rmse(runs[0]) - _rmse(runs[1])
    return Difference(value, low, high, scope, n, not reason, reason)


def _common(all_phases: Sequence[Phases]) -> Ints:
    common = all_phases[0].bin if all_phases else np.zeros(0, dtype=np.int64)
    for phases in all_phases[1:]:
        common = np.intersect1d(common, phases.bin)
    if len(common) < MIN_BINS:
        raise EstimationError(
            f"{len(common)} bins of the motion are in all repeats of both runs",
            fix=f"at least {MIN_BINS}: two runs of the same motion at the same speed",
        )
    return common


def _rows(phases: Phases, common: Ints) -> Floats:
    return phases.mean_square[np.searchsorted(phases.bin, common)]


def _rmse(mean_square: Floats) -> float:
    return float(np.sqrt(mean_square.mean()))
