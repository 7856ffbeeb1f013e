"""The time by which one recording of a motion runs behind another of the same motion."""

from __future__ import annotations

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Bools, Floats
from vrbench.trajectory import NS, Trajectory

GRID_HZ = 50.0
MAX_LAG_S = 10.0
MIN_OVERLAP = 0.5
ROUNDS = 8


def find_lag(a: Trajectory, b: Trajectory, max_lag_s: float = MAX_LAG_S) -> int:
    """The lag [ns] at which b comes closest to a: `b(t + lag)` is `a(t)`.

    First the least mean-square distance over lags on a grid, then Gauss-Newton on the interpolated
    positions. No alignment in space.

    Args:
        a: a motion, in a frame both share.
        b: the same motion, at any other time.
        max_lag_s: how far starts of the two may lie apart from each other [s].

    Raises:
        EstimationError: too few samples, no motion, or no overlap of half the shorter one.
    """
    if len(a) < 2 or len(b) < 2:
        raise EstimationError("a lag needs two samples of each recording")
    apart = int(b.t[0] - a.t[0])
    lag = apart + round(_on_grid(_positions(a), _positions(b), max_lag_s) * NS)
    for _ in range(ROUNDS):
        left, step = _differences(a, b, lag)
        power = float(np.sum(step * step))
        if power == 0.0:
            raise EstimationError("nothing moves, so no lag can be seen")
        change = -float(np.sum(left * step)) / power
        lag += round(change * NS)
        if abs(change) < 1e-7:
            break
    return lag


def differences(a: Trajectory, b: Trajectory, lag: int) -> Floats:
    """Differences (k, 3) [m] of b, `lag` [ns] later, to a, at a's stamps that b covers."""
    t = a.t + lag
    inside = _inside(b, t)
    return b.position_at(t[inside]) - a.pose.p[inside]


def _differences(a: Trajectory, b: Trajectory, lag: int) -> tuple[Floats, Floats]:
    """The differences and the velocities (k, 3) [m/s] of b there."""
    t = a.t + lag
    t = t[_inside(b, t)]
    half = round(0.5 * b.period_s * NS)
    before, after = (b.position_at(np.clip(t + d, b.t[0], b.t[-1])) for d in (-half, half))
    return differences(a, b, lag), (after - before) * NS / (2 * half)


def _inside(b: Trajectory, t: np.ndarray) -> Bools:
    inside: Bools = (t >= b.t[0]) & (t <= b.t[-1])
    if np.count_nonzero(inside) < 2:
        raise EstimationError("the two recordings do not overlap")
    return inside


def _positions(x: Trajectory) -> Floats:
    grid = np.arange(0, int(x.t[-1] - x.t[0]) + 1, round(NS / GRID_HZ)) + x.t[0]
    return x.position_at(grid)


def _on_grid(a: Floats, b: Floats, max_lag_s: float) -> float:
    """The lag [s] of least mean-square distance, by the sums of its terms over each overlap."""
    middle = a.mean(axis=0)
    a, b = a - middle, b - middle
    most = min(round(max_lag_s * GRID_HZ), max(len(a), len(b)) - 1)
    lags = np.arange(-most, most + 1)
    size = 1 << (len(a) + len(b)).bit_length()
    product = np.fft.irfft(
        np.conj(np.fft.rfft(a, size, axis=0)) * np.fft.rfft(b, size, axis=0), size, axis=0
    )
    cross = product.sum(axis=1)[lags]
    start, stop = np.maximum(0, -lags), np.minimum(len(a), len(b) - lags)
    enough = stop - start >= MIN_OVERLAP * min(len(a), len(b))
    if not enough.any():
        raise EstimationError("the two recordings do not overlap")
    lags, cross, start, stop = (x[enough] for x in (lags, cross, start, stop))
    sum_a, sum_b = (np.concatenate(([0.0], np.cumsum(np.sum(x * x, axis=1)))) for x in (a, b))
    squares = sum_a[stop] - sum_a[start] + sum_b[stop + lags] - sum_b[start + lags]
    return float(lags[np.argmin((squares - 2 * cross) / (stop - start))]) / GRID_HZ
