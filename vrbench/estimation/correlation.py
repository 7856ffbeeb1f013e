"""Masked, normalised correlation of angular speed: how alike two motions are at every lag."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vrbench.errors import EstimationError
from vrbench.geometry import Bools, Floats, Ints, relative_angle
from vrbench.trajectory import MAX_GAP_PERIODS, NS, Trajectory

Spectrum = npt.NDArray[np.complex128]

STEP_NS = 20_000_000
BASELINE_NS = 200_000_000
# A recorder's hiccup within the baseline changes little; lost tracking is masked.
SHORTEST_GAP_NS = 50_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """Angular speed on a regular grid.

    Attributes:
        start_ns: time of the first value [ns].
        value: angular speed (n,) [rad/s], 0 where masked.
        mask: where it is known (n,).
    """

    start_ns: int
    value: Floats
    mask: Bools

    @property
    def t(self) -> Ints:
        return self.start_ns + STEP_NS * np.arange(len(self.value), dtype=np.int64)

    def between(self, start_ns: int, end_ns: int) -> Signal:
        """The part with start <= t <= end."""
        t = self.t
        first = int(np.searchsorted(t, start_ns))
        part = slice(first, int(np.searchsorted(t, end_ns, side="right")))
        return Signal(self.start_ns + STEP_NS * first, self.value[part], self.mask[part])

    def limited(self, largest: float) -> Signal:
        """The same, masked where it is above `largest` [rad/s]."""
        mask = self.mask & (self.value <= largest)
        return Signal(self.start_ns, np.where(mask, self.value, 0.0), mask)


@dataclass(frozen=True, slots=True, eq=False)
class Correlation:
    """The correlation of two signals by offset (the second's clock minus the first's).

    Attributes:
        offset_ns: offsets (m,) [ns], increasing by `STEP_NS`.
        r: Pearson's correlation over the common part (m,), NaN where too little is common.
        common: how many values are common (m,).
    """

    offset_ns: Ints
    r: Floats
    common: Floats


def angular_speed(trajectory: Trajectory) -> Signal:
    """Angular speed over a baseline of 0.2 s, on a grid of 20 ms, masked at gaps.

    It is the same in every frame, and the baseline averages what the two streams' rates and
    noises would make different.
    """
    half = BASELINE_NS // 2
    n = int((trajectory.t[-1] - trajectory.t[0] - BASELINE_NS) // STEP_NS) + 1
    if n < 2:
        raise EstimationError(
            f"lasts {trajectory.duration_s:.3g} s", fix="seconds of motion are needed"
        )
    start = int(trajectory.t[0]) + half
    t = start + STEP_NS * np.arange(n, dtype=np.int64)
    ends = np.concatenate((t - half, t + half))
    q = trajectory.at(ends).q
    value = relative_angle(q[:n], q[n:]) / (BASELINE_NS / NS)
    gaps = _gaps(trajectory)
    touched = np.searchsorted(gaps[:, 1], t - half, side="right") != np.searchsorted(
        gaps[:, 0], t + half, side="left"
    )
    return Signal(start, np.where(touched, 0.0, value), ~touched)


def correlate(first: Signal, second: Signal, low_ns: float, high_ns: float) -> Correlation:
    """The correlation at offsets from `low_ns` to `high_ns`, by FFT, every sum over the
    common known part alone (Padfield, 2012): zero padding would pull the peak.
    """
    start = second.start_ns - first.start_ns
    n1, n2 = len(first.value), len(second.value)
    # at lag k the second's value j + k stands beside the first's value j
    lags = np.arange(-(n1 - 1), n2, dtype=np.int64)
    offsets = start + lags * STEP_NS
    wanted = (offsets >= low_ns) & (offsets <= high_ns)
    size = 1 << int(np.ceil(np.log2(n1 + n2)))
    mean = np.concatenate((first.value[first.mask], second.value[second.mask])).mean()
    m1, m2 = first.mask.astype(float), second.mask.astype(float)
    f1, f2 = (first.value - mean) * m1, (second.value - mean) * m2
    a = [np.conj(np.fft.rfft(x, size)) for x in (m1, f1, f1 * f1)]
    b = [np.fft.rfft(x, size) for x in (m2, f2, f2 * f2)]
    index = lags[wanted] % size

    def total(x: Spectrum, y: Spectrum) -> Floats:
        return np.fft.irfft(x * y, size)[index]

    common = np.maximum(np.rint(total(a[0], b[0])), 1.0)
    s1, s2 = total(a[1], b[0]), total(a[0], b[1])
    v1 = total(a[2], b[0]) - s1 * s1 / common
    v2 = total(a[0], b[2]) - s2 * s2 / common
    cross = total(a[1], b[1]) - s1 * s2 / common
    floor = 1e-9 * common * max(float(np.var(f1)), float(np.var(f2)), 1e-300)
    known = (v1 > floor) & (v2 > floor)
    r = np.where(known, cross / np.sqrt(np.where(known, v1 * v2, 1.0)), np.nan)
    return Correlation(offsets[wanted], r, common)


def refined_peak(correlation: Correlation, index: int) -> tuple[float, float]:
    """The peak near sample `index` between the samples: offset [ns] and correlation there.

    Angular speed over the baseline is band-limited well below the grid's rate, so a polynomial
    of fourth degree through seven samples has the true peak within some 10 us.
    """
    low, high = max(index - 3, 0), min(index + 4, len(correlation.r))
    x, r = np.arange(low, high) - index, correlation.r[low:high]
    known = np.isfinite(r)
    fit = np.polynomial.Polynomial.fit(x[known], r[known], min(4, int(known.sum()) - 1))
    fine = np.linspace(-1.0, 1.0, 2001)
    values = fit(fine)
    best = int(np.argmax(values))
    return float(correlation.offset_ns[index] + fine[best] * STEP_NS), float(values[best])


def _gaps(trajectory: Trajectory) -> Ints:
    """Starts and ends (k, 2) [ns] of the intervals without samples."""
    steps = np.diff(trajectory.t)
    longest = max(MAX_GAP_PERIODS * float(np.median(steps)), SHORTEST_GAP_NS)
    at = np.flatnonzero(steps > longest)
    return np.stack((trajectory.t[at], trajectory.t[at + 1]), axis=1)
