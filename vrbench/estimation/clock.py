"""The clock between two pose streams, from angular speed alone: no frame needs to be known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vrbench.clocks import ClockMap
from vrbench.errors import EstimationError
from vrbench.estimation.checks import require_poses
from vrbench.estimation.correlation import (
    BASELINE_NS,
    STEP_NS,
    Signal,
    angular_speed,
    correlate,
    refined_peak,
)
from vrbench.estimation.drift import LONG_TAKE_S, Stretch, fit_drift
from vrbench.estimation.outliers import informative
from vrbench.geometry import Bools, Floats, Ints
from vrbench.trajectory import NS, Trajectory

MINIMUM_POSES = 20
MINIMUM_OVERLAP_S = 5.0
MAX_SEARCH_S = 600.0
MINIMUM_CORRELATION = 0.7
MINIMUM_DISTINCTNESS = 1.03
# The standard deviation of angular speed that noise and a hand at rest don't reach.
MINIMUM_MOTION_RAD_S = np.radians(1.0)
# No headset outruns its reference; what does is a jump of the tracking.
LARGEST_SPEED_RATIO = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class ClockFit:
    """A clock, and how far it can be believed.

    Attributes:
        clock: from the estimate's clock to the reference's.
        offset_s: the estimate's clock minus the reference's, in the middle of the overlap [s].
        skew: growth of the offset [s/s]; 0 in takes of less than ten minutes.
        correlation: of the angular speeds at that offset; in takes of more than ten minutes, of the
            ten with most motion; with steps, the least of the stretches.
        distinctness: `correlation` over that of the next separate peak; inf if there is none.
        residual_s: root mean square difference between the offsets of local windows and the
            clock [s]; None if the overlap holds fewer than two windows.
        overlap_s: how long both streams are known, with that offset [s].
        local_t: middles (k,) [ns] of windows of 30 s, on the estimate's clock.
        local_ns: offsets (k,) [ns] of those windows alone.
    """

    clock: ClockMap
    offset_s: float
    skew: float
    correlation: float
    distinctness: float
    residual_s: float | None
    overlap_s: float
    local_t: Ints
    local_ns: Floats


def estimate_clock(
    reference: Trajectory,
    estimate: Trajectory,
    *,
    search_s: float | None = None,
    around_s: float = 0.0,
    steps_ns: Sequence[int] = (),
) -> ClockFit:
    """The clock that maps the estimate's time to the reference's.

    Args:
        reference: the stream that counts as truth.
        estimate: the other stream.
        search_s: how far from `around_s` the offset may lie [s]; in looped motion less than half
            a loop. Ten minutes if not given.
        around_s: where the search is centred [s], if the offset is roughly known.
        steps_ns: times on the estimate's clock [ns] at which the offset jumped (a clock was set).

    Raises:
        EstimationError: values not finite, too few poses, no overlap in time within the search,
            too little motion, no correlation, more than one offset that fits.
    """
    require_poses(reference, "reference", MINIMUM_POSES)
    require_poses(estimate, "estimate", MINIMUM_POSES)
    reach_s = MAX_SEARCH_S if search_s is None else search_s
    _require_overlap(reference, estimate, around_s, reach_s)
    first, second = _signals(reference, estimate)
    stretches = _stretches(second, estimate, steps_ns)
    seeds = [
        _seed(first, _liveliest(stretch.signal), around_s, reach_s, _place(stretch, len(stretches)))
        for stretch in stretches
    ]
    # the least certain stretch speaks for the take
    main = min(seeds, key=lambda seed: seed.correlation)
    drift = fit_drift(first, stretches, [seed.offset_ns for seed in seeds])
    t = second.t
    middle = int(t[0] + (t[-1] - t[0]) // 2)
    return ClockFit(
        clock=drift.clock,
        offset_s=float(drift.clock.offset_ns(middle)) / NS,
        skew=drift.skew,
        correlation=main.correlation,
        distinctness=main.distinctness,
        residual_s=drift.residual_s,
        overlap_s=_overlap_s(first, second, drift.clock),
        local_t=drift.local_t,
        local_ns=drift.local_ns,
    )


@dataclass(frozen=True, slots=True)
class _Seed:
    offset_ns: float
    correlation: float
    distinctness: float


def _seed(
    first: Signal, second: Signal, around_s: float, reach_s: float, place: str | None
) -> _Seed:
    """One constant offset for the whole of `second`."""
    low, high = (around_s - reach_s) * NS, (around_s + reach_s) * NS
    # one lobe more on each side, so that a peak at the border is seen to be one
    margin = 1.0 * NS
    enough = _enough(first, second)
    if second.mask.sum() * STEP_NS < MINIMUM_OVERLAP_S * NS:
        raise EstimationError(
            f"tracked for {second.mask.sum() * STEP_NS / NS:.3g} s only",
            field=place or "estimate",
            fix=f"at least {MINIMUM_OVERLAP_S:g} s are needed to find a clock",
        )
    found = correlate(first, second, low - margin, high + margin)
    r = np.where(found.common >= enough, found.r, np.nan)
    inside = (found.offset_ns >= low) & (found.offset_ns <= high)
    if not np.isfinite(r[inside]).any():
        raise EstimationError(
            f"the two streams have no {enough * STEP_NS / NS:.3g} s of motion in common within "
            f"{reach_s:g} s of an offset of {around_s:g} s",
            field=place,
            fix="widen the search, or record both streams at the same time",
        )
    best = int(np.nanargmax(np.where(inside, r, np.nan)))
    offset, peak = refined_peak(found, best)
    if peak < MINIMUM_CORRELATION:
        raise EstimationError(
            f"the angular speeds of the two streams correlate by {peak:.2f} at best "
            f"(offset {offset / NS:.3f} s)",
            field=place,
            fix=f"{MINIMUM_CORRELATION} or more is needed: are both streams of one motion?",
        )
    if np.any(r[max(best - 1, 0) : best + 2] > r[best]):
        raise EstimationError(
            f"the correlation still grows where the search ends, at {offset / NS:.3f} s",
            field=place,
            fix=f"the search reaches {reach_s:g} s from {around_s:g} s; widen or move it",
        )
    other, at = _next_peak(r, best, inside)
    if other > 0.0 and peak < MINIMUM_DISTINCTNESS * other:
        raise EstimationError(
            f"two offsets fit alike: {offset / NS:.3f} s (correlation {peak:.4f}) and "
            f"{found.offset_ns[at] / NS:.3f} s ({other:.4f})",
            field=place,
            fix="the motion repeats: bound the search to less than half a loop",
        )
    return _Seed(offset, peak, peak / other if other > 0.0 else np.inf)


def _liveliest(signal: Signal) -> Signal:
    """The ten minutes in which the angular speed varies most: over hours, skew smears the peak."""
    size = int(LONG_TAKE_S * NS / STEP_NS)
    if len(signal.value) <= size:
        return signal
    starts = range(0, len(signal.value) - size + 1, size)
    best = max(starts, key=lambda i: float(np.var(signal.value[i : i + size])))
    return signal.between(int(signal.t[best]), int(signal.t[best + size - 1]))


def _overlap_s(first: Signal, second: Signal, clock: ClockMap) -> float:
    """For how long both signals are known [s]."""
    t = clock.to_reference(second.t[second.mask])
    at = (t - first.start_ns + STEP_NS // 2) // STEP_NS
    at = at[(at >= 0) & (at < len(first.mask))]
    return float(first.mask[at].sum()) * STEP_NS / NS


def _next_peak(r: Floats, best: int, inside: Bools) -> tuple[float, int]:
    """The largest correlation beyond the valleys on both sides of the best, and where it is."""
    filled = np.where(np.isfinite(r), r, -1.0)
    left = best
    while left > 0 and filled[left - 1] < filled[left]:
        left -= 1
    right = best
    while right < len(r) - 1 and filled[right + 1] < filled[right]:
        right += 1
    separate = inside & np.isfinite(r)
    separate[left : right + 1] = False
    if not separate.any():
        return 0.0, best
    at = int(np.argmax(np.where(separate, filled, -1.0)))
    return float(filled[at]), at


def _enough(first: Signal, second: Signal) -> float:
    """How many values two signals must have in common: half of what the shorter has."""
    shorter = min(first.mask.sum(), second.mask.sum())
    return max(0.5 * float(shorter), MINIMUM_OVERLAP_S * NS / STEP_NS)


def _signals(reference: Trajectory, estimate: Trajectory) -> tuple[Signal, Signal]:
    for name, trajectory in (("reference", reference), ("estimate", estimate)):
        if trajectory.duration_s < MINIMUM_OVERLAP_S:
            raise EstimationError(
                f"lasts {trajectory.duration_s:.3g} s ({len(trajectory)} poses)",
                field=name,
                fix=f"at least {MINIMUM_OVERLAP_S:g} s are needed to find a clock",
            )
    first = angular_speed(reference)
    fastest = float(first.value.max())
    moving = estimate[informative(estimate, fastest)]
    if len(moving) < MINIMUM_POSES or moving.duration_s < MINIMUM_OVERLAP_S:
        raise EstimationError(
            f"tells one and the same pose: only {len(moving)} of {len(estimate)} poses are new",
            field="estimate",
            fix="a clock needs motion, and tracking that follows it",
        )
    second = angular_speed(moving)
    if first.mask.any():
        second = second.limited(LARGEST_SPEED_RATIO * fastest)
    for name, signal in (("reference", first), ("estimate", second)):
        spread = float(np.std(signal.value[signal.mask])) if signal.mask.any() else 0.0
        if spread < MINIMUM_MOTION_RAD_S:
            raise EstimationError(
                f"hardly turns: its angular speed varies by {np.degrees(spread):.2g} deg/s",
                field=name,
                fix=f"a clock needs {np.degrees(MINIMUM_MOTION_RAD_S):.2g} deg/s or more",
            )
    return first, second


def _stretches(signal: Signal, estimate: Trajectory, steps_ns: Sequence[int]) -> list[Stretch]:
    """The signal cut where its clock was set."""
    first, last = int(estimate.t[0]), int(estimate.t[-1])
    inner = sorted({int(step) for step in steps_ns if first < step <= last})
    half = BASELINE_NS // 2 if inner else 0
    return [
        Stretch(a, b - 1, signal.between(a + half, b - half))
        for a, b in pairwise([first, *inner, last + 1])
    ]


def _place(stretch: Stretch, count: int) -> str | None:
    """Which part of the estimate is meant, if it has several."""
    if count == 1:
        return None
    return f"estimate from {stretch.start_ns / NS:.3f} to {stretch.end_ns / NS:.3f} s"


def _require_overlap(
    reference: Trajectory, estimate: Trajectory, around_s: float, reach_s: float
) -> None:
    shift = int(around_s * NS)
    start = max(reference.t[0], estimate.t[0] - shift)
    end = min(reference.t[-1], estimate.t[-1] - shift)
    # with the offset as far off as the search allows, but no more in common than the shorter has
    shared_s = min((end - start) / NS + reach_s, reference.duration_s, estimate.duration_s)
    wanted = min(reference.duration_s, estimate.duration_s, MINIMUM_OVERLAP_S)
    if shared_s < wanted:
        raise EstimationError(
            f"the streams do not overlap in time: the reference spans {_span(reference)}, the "
            f"estimate {_span(estimate)}, {(start - end) / NS:.6g} s apart",
            fix=f"clocks may differ by up to {reach_s:g} s: record both streams at the same time",
        )


def _span(trajectory: Trajectory) -> str:
    return f"{trajectory.t[0] / NS:.3f} to {trajectory.t[-1] / NS:.3f} s"
