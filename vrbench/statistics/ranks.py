"""Ranks with their doubt: which of several numbers can be told apart, and which places they take.

A difference must stand out twice: from the scatter between mounts (or sittings) alone, and from
that together with its scatter along the motion, where what is hard for both cancels (pairing by
phase). Few mounts show their scatter badly, and a small one by chance would pass for precision; so
each number's is taken to be at least what is usual among all that are ranked, as a share of the
number. Degrees of freedom follow Welch (1947).

Many numbers make many pairs. Benjamini and Hochberg (1995) keep the expected share of wrong ones
among the pairs that are told apart at 5 %, as NAEP's comparisons of states do (Williams, Jones and
Tukey, 1999).

Places follow as confidence sets for ranks do (Mogstad, Romano, Shaikh and Wilhelm, 2024): the best
is one more than there are numbers told to be better, the worst is as far from the end as there are
numbers told to be worse. Two that can't be told apart have places in common; where A ~ B and
B ~ C, but A < C, the places are 1-2, 1-3 and 2-3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from vrbench.estimation.blocks import block_length
from vrbench.geometry import Floats, Ints
from vrbench.statistics.bootstrap import LEVEL, MIN_BLOCKS

Flags = npt.NDArray[np.bool_]
# With fewer bins, numbers are compared without pairing.
MIN_BINS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A number, and how it scatters.

    Attributes:
        value: the number; less is better.
        clusters: the same of each mount, or of each sitting where there are several (k,); k > 1.
        bin: numbers of the bins of the motion's phase (b,), increasing; empty where not known.
        by_bin: the same of each bin (b,); the mean is the number.
        size: what its scatter is a share of: the error itself, also where the number is a change
            of it.
        floor: the error that the measurement alone would show; 0 where not known.
    """

    value: float
    clusters: Floats
    bin: Ints
    by_bin: Floats
    size: float
    floor: float = 0.0


@dataclass(frozen=True, slots=True)
class Separation:
    """How much larger one number is than another.

    Attributes:
        value: the difference.
        low: lower end of its 95 % interval,
        high: and its upper end.
        paired: whether the motion's phases were paired.
        told: whether the two can be told apart.
    """

    value: float
    low: float
    high: float
    paired: bool
    told: bool


def rank(measured: Sequence[Measured], level: float = LEVEL) -> list[tuple[int, int]]:
    """The best and the worst place of each number among them all, from 1."""
    told = told_apart(measured, level)
    values = np.array([m.value for m in measured])
    better = told & (values[None, :] < values[:, None])
    worse = told & (values[None, :] > values[:, None])
    best, last = 1 + better.sum(axis=1), len(values) - worse.sum(axis=1)
    return list(zip(best.tolist(), last.tolist(), strict=True))


def told_apart(measured: Sequence[Measured], level: float = LEVEL) -> Flags:
    """Which pairs of numbers can be told apart (n, n), level the share of them that are right."""
    n = len(measured)
    told = np.zeros((n, n), dtype=np.bool_)
    if n > 1:
        pairs = _Pairs(measured)
        told[pairs.first, pairs.second] = _discoveries(pairs.chances(1.0 - level), 1.0 - level)
    return told | told.T


def separation(first: Measured, second: Measured, level: float = LEVEL) -> Separation:
    """How much larger the first number is than the second."""
    pairs = _Pairs((first, second))
    value = first.value - second.value
    half = float(pairs.half_widths(level)[0])
    told = bool(pairs.chances()[0] <= 1.0 - level)
    return Separation(value, value - half, value + half, pairs.blocks > 1, told)


def interval(measured: Measured, level: float = LEVEL) -> tuple[float, float]:
    """The interval of one number, by both its scatters."""
    from scipy.special import stdtrit

    own, freedom = _between_clusters((measured,))
    nothing = replace(measured, by_bin=np.zeros(len(measured.bin)))
    along, _ = _along_the_motion((measured, nothing), np.array([0]), np.array([1]))
    half = float(stdtrit(freedom, (1.0 + level) / 2.0) * np.sqrt(own[0] + along[0]))
    return measured.value - half, measured.value + half


class _Pairs:
    """All pairs of some numbers: their differences, variances and degrees of freedom (p,)."""

    def __init__(self, measured: Sequence[Measured]) -> None:
        self.first, self.second = np.triu_indices(len(measured), 1)
        values = np.array([m.value for m in measured])
        buried = np.array([m.size <= m.floor for m in measured])
        self._apart = np.abs(values[self.first] - values[self.second])
        self._buried = buried[self.first] & buried[self.second]
        own, self._own_freedom = _between_clusters(measured)
        self._own = own[self.first] + own[self.second]
        along, self.blocks = _along_the_motion(measured, self.first, self.second)
        self._both = self._own + along
        self._freedom = np.full(len(along), self._own_freedom)
        if self.blocks > 1:
            spent = self._own**2 / self._own_freedom + along**2 / (self.blocks - 1)
            np.divide(self._both**2, spent, out=self._freedom, where=spent > 0)

    def chances(self, enough: float = 1.0) -> Floats:
        """How likely so large a difference is of two numbers that are the same.

        Args:
            enough: chances above it may be given as 1.
        """
        from scipy.special import stdtr, stdtrit

        with np.errstate(divide="ignore", invalid="ignore"):
            alone, together = self._apart / np.sqrt(self._own), self._apart / np.sqrt(self._both)
        chance = np.ones(len(alone))
        open_ = alone > -stdtrit(self._own_freedom, enough / 2.0)
        chance[open_] = 2.0 * stdtr(self._freedom[open_], -together[open_])
        # the smaller t is the likelier, unless it has the lighter tail
        lighter = open_ & (self._freedom > self._own_freedom)
        by_clusters = 2.0 * stdtr(self._own_freedom, -alone[lighter])
        chance[lighter] = np.maximum(chance[lighter], by_clusters)
        chance[self._buried | (self._apart == 0.0)] = 1.0
        return chance

    def half_widths(self, level: float) -> Floats:
        """How far their intervals reach to either side."""
        from scipy.special import stdtrit

        tail = (1.0 + level) / 2.0
        alone = stdtrit(self._own_freedom, tail) * np.sqrt(self._own)
        together = stdtrit(self._freedom, tail) * np.sqrt(self._both)
        widest: Floats = np.maximum(alone, together)
        return widest


def _between_clusters(measured: Sequence[Measured]) -> tuple[Floats, float]:
    """Variance of each number by the scatter of its clusters (n,), and the degrees of freedom."""
    counts = np.array([len(m.clusters) for m in measured])
    scatter = np.array([np.var(m.clusters, ddof=1) for m in measured])
    scale = np.array([m.size for m in measured]) ** 2
    share = np.divide(scatter, scale, out=np.zeros(len(scale)), where=scale > 0)
    usual = np.sum(share * (counts - 1)) / np.sum(counts - 1)
    return np.maximum(scatter, usual * scale) / counts, float(np.sum(counts - 1))


def _along_the_motion(
    measured: Sequence[Measured], first: Ints, second: Ints
) -> tuple[Floats, int]:
    """Variance of each pair's difference along the motion (p,), and the number of blocks.

    A bin that a number lacks counts as its mean. Where bins are wanting, there is nothing to pair:
    no variance, one block.
    """
    if any(len(m.bin) < MIN_BINS for m in measured):
        return np.zeros(len(first)), 1
    grid = np.unique(np.concatenate([m.bin for m in measured]))
    off = np.zeros((len(measured), len(grid)))
    for row, m in zip(off, measured, strict=True):
        row[np.searchsorted(grid, m.bin)] = m.by_bin - m.by_bin.mean()
    length = max(1, min(max(block_length(row) for row in off), len(grid) // MIN_BLOCKS))
    blocks = len(grid) // length
    means = off[:, : blocks * length].reshape(len(off), blocks, length).mean(axis=2)
    means -= means.mean(axis=1, keepdims=True)
    covariance = means @ means.T / (blocks * (blocks - 1))
    own = np.diag(covariance)
    along: Floats = own[first] + own[second] - 2.0 * covariance[first, second]
    return np.maximum(along, 0.0), blocks


def _discoveries(chances: Floats, rate: float) -> Flags:
    """Which of many chances (p,) are small enough: Benjamini and Hochberg's step-up."""
    m = len(chances)
    ordered = np.sort(chances)
    passed = np.flatnonzero(ordered <= rate * np.arange(1, m + 1) / m)
    found: Flags = chances <= (ordered[passed[-1]] if len(passed) else -1.0)
    return found
