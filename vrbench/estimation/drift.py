"""How an offset changes through a take: local offsets, and the piecewise-affine clock in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vrbench.clocks import ClockMap
from vrbench.errors import EstimationError
from vrbench.estimation.correlation import Signal, correlate, refined_peak
from vrbench.geometry import Bools, Floats, Ints
from vrbench.trajectory import NS

# In less time a crystal's skew can't be told from what else moves the offset.
LONG_TAKE_S = 600.0
KNOT_SPACING_S = 120.0
WINDOW_S = 30.0
# 100 ppm for two hours, to either side of the seed: more than any crystal, less than a loop.
LOCAL_SEARCH_S = 0.8
MINIMUM_LOCAL_CORRELATION = 0.8
# Between windows a minute and a half apart, no crystal changes so: 333 ppm. With scatter beside it.
LARGEST_CHANGE_NS = 30e6
STEP_CUT = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """A part of the estimate that keeps one clock: from `start_ns` to `end_ns` on that clock."""

    start_ns: int
    end_ns: int
    signal: Signal


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """A clock through local offsets.

    Attributes:
        clock: from the second signal's clock to the first's.
        skew: mean growth of the offset within the stretches [s/s].
        residual_s: root mean square of the local offsets about the clock [s], or None.
        local_t: middles (k,) [ns] of the windows, on the second's clock.
        local_ns: their local offsets (k,) [ns].
    """

    clock: ClockMap
    skew: float
    residual_s: float | None
    local_t: Ints
    local_ns: Floats


def fit_drift(first: Signal, stretches: Sequence[Stretch], seeds_ns: Sequence[float]) -> Drift:
    """The clock through stretches of `second` that each keep one clock.

    A stretch of less than ten minutes has the constant offset of its seed. A longer one has local
    offsets of windows of 30 s, and as many pieces, 120 s or longer, as Schwarz's criterion grants.

    Raises:
        EstimationError: a long stretch in which hardly a window correlates, or the offset jumps.
    """
    knots: list[Ints] = []
    offsets: list[Floats] = []
    windows: list[tuple[Ints, Floats]] = []
    errors: list[Floats] = []
    skews: list[tuple[float, float]] = []
    for stretch, seed_ns in zip(stretches, seeds_ns, strict=True):
        t, local = local_offsets(first, stretch.signal, seed_ns)
        windows.append((t, local))
        span_s = (stretch.end_ns - stretch.start_ns) / NS
        ends = np.array([stretch.start_ns, stretch.end_ns], dtype=np.int64)
        if span_s < LONG_TAKE_S:
            at, values = ends, np.full(2, seed_ns)
        else:
            at, values = _piecewise(t, local, ends)
        knots.append(at)
        offsets.append(values)
        errors.append(local - ClockMap(at, values).offset_ns(t))
        skews.append(((values[-1] - values[0]) / float(at[-1] - at[0]), span_s))
    every = np.concatenate(errors)
    # a window that holds a jump of the tracking says nothing about the clock
    residual = 1.4826 * float(np.median(np.abs(every))) if len(every) > 1 else None
    weights = np.array([span for _, span in skews])
    skew = float(np.array([value for value, _ in skews]) @ weights / weights.sum())
    clock = ClockMap(np.concatenate(knots), np.concatenate(offsets))
    return Drift(
        clock=clock,
        skew=skew,
        residual_s=None if residual is None else residual / NS,
        local_t=np.concatenate([t for t, _ in windows]),
        local_ns=np.concatenate([local for _, local in windows]),
    )


def local_offsets(first: Signal, second: Signal, seed_ns: float) -> tuple[Ints, Floats]:
    """Middles (k,) [ns] of windows of 30 s on the second's clock, and their offsets (k,) [ns]."""
    window_ns, reach = int(WINDOW_S * NS), LOCAL_SEARCH_S * NS
    t, found = [], []
    for start in range(second.start_ns, int(second.t[-1]) - window_ns + 1, window_ns):
        part = second.between(start, start + window_ns - 1)
        near = int(start - seed_ns)
        against = first.between(near - int(2 * reach), near + window_ns + int(2 * reach))
        if part.mask.mean() < 0.5 or len(against.value) < 2 or against.mask.mean() < 0.5:
            continue
        if np.std(part.value[part.mask]) == 0.0:
            continue
        correlation = correlate(against, part, seed_ns - reach, seed_ns + reach)
        enough = correlation.common >= 0.5 * part.mask.sum()
        r = np.where(enough, correlation.r, np.nan)
        if not np.isfinite(r).any():
            continue
        best = int(np.nanargmax(r))
        offset, peak = refined_peak(correlation, best)
        if 0 < best < len(r) - 1 and peak >= MINIMUM_LOCAL_CORRELATION:
            t.append(start + window_ns // 2)
            found.append(offset)
    return np.array(t, dtype=np.int64), np.array(found)


def _piecewise(t: Ints, local: Floats, ends: Ints) -> tuple[Ints, Floats]:
    """Knots [ns] and offsets [ns] of the continuous piecewise-affine function through points."""
    if len(t) < 6:
        raise EstimationError(
            f"only {len(t)} windows of {WINDOW_S:g} s correlate in "
            f"{(ends[1] - ends[0]) / NS:.0f} s",
            fix="the drift of a long take needs motion throughout",
        )
    believed = _without_outliers(local)
    t, local = t[believed], local[believed]
    _refuse_steps(t, local)
    most = int((ends[1] - ends[0]) / NS // KNOT_SPACING_S)
    best: tuple[float, Ints, Floats] | None = None
    pieces = 1
    while pieces <= most and 3 * (pieces + 1) <= len(t):
        knots = np.linspace(ends[0], ends[1], pieces + 1).astype(np.int64)
        values, cost = _hat_fit(t, local, knots)
        score = len(t) * np.log(cost) + (pieces + 1) * np.log(len(t))
        if best is None or score < best[0]:
            best = (score, knots, values)
        pieces *= 2
    assert best is not None
    return best[1], best[2]


def _refuse_steps(t: Ints, local: Floats) -> None:
    """Raises EstimationError where the offset jumps from three windows to the next three."""
    if len(local) < 6:
        return
    middle = np.median(np.lib.stride_tricks.sliding_window_view(local, 3), axis=1)
    jump = middle[3:] - middle[:-3]
    jump -= np.median(jump)
    scatter = 1.4826 * float(np.median(np.abs(np.diff(local))))
    at = int(np.argmax(np.abs(jump)))
    if abs(jump[at]) > LARGEST_CHANGE_NS + STEP_CUT * scatter:
        raise EstimationError(
            f"the clock jumps by {jump[at] / 1e6:.0f} ms near {t[at + 3] / NS:.0f} s: it was set "
            "while it ran",
            field="estimate",
            fix="cut the recording there, or let events of the take tell of the step",
        )


def _without_outliers(local: Floats) -> Bools:
    """Which offsets (k,) lie near the median of themselves and their four neighbours."""
    padded = np.concatenate((local[2:0:-1], local, local[-2:-4:-1]))
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    error = np.abs(local - smooth)
    return error <= 6.0 * 1.4826 * max(float(np.median(error)), 1e3)


def _hat_fit(t: Ints, local: Floats, knots: Ints) -> tuple[Floats, float]:
    """Values at the knots by least squares, and the mean square error [ns^2]."""
    s, s_knots = (t - knots[0]) / NS, (knots - knots[0]) / NS
    basis = np.stack([np.interp(s, s_knots, hat) for hat in np.eye(len(knots))], axis=1)
    middle = float(np.median(local))
    solution, *_ = np.linalg.lstsq(basis, local - middle, rcond=None)
    error = local - middle - basis @ solution
    # nanoseconds squared, from 1 ns on: exact data have no logarithm
    return solution + middle, float(np.mean(error**2)) + 1.0
