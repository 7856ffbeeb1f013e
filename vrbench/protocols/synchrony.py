"""The streams of a take brought onto one clock, as all steps of `vrbench-1` begin."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vrbench.estimation.clock import MAX_SEARCH_S, ClockFit, estimate_clock
from vrbench.estimation.interpolation import PoseSpline
from vrbench.estimation.trim import active_window
from vrbench.protocols.protocol import headset_samples, reference_samples
from vrbench.protocols.stretches import spans
from vrbench.streams import Columns, Samples
from vrbench.trajectory import NS, Trajectory

# Of a loop's duration: how far from what the times of arrival tell the offset is searched.
SEARCH_SHARE = 0.45
# Over how long, before and after a step of the host's clock, the times of arrival are compared.
ARRIVALS_S = 10.0
# Of the year 2001: no recording is older, and no device has been on for so long.
FIRST_DATE_S = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Synchrony:
    """A take's two streams, and the clock between them.

    Attributes:
        moving: `T_base_tcp` while the reference moves.
        spline: the same between its samples.
        estimate: `T_world_eye`, the good poses, on the headset's clock.
        clock_fit: from that clock to the reference's.
    """

    moving: Trajectory
    spline: PoseSpline
    estimate: Trajectory
    clock_fit: ClockFit


@lru_cache(maxsize=1)
def synchronised(columns: Columns, reference: str) -> Synchrony:
    """The reference in its active window, the headset's good poses, and the clock between them.

    The search for the offset is centred on what the times of arrival tell of it, so that clocks
    that count from a device's start are found too. In a take of loops it stays within half a loop.
    Where a stream has no times of arrival and its clock is far off, as one that counts from a
    device's start, it is centred on where both streams begin.
    The last take is kept, for a take is scored in several ways one after the other.

    Raises:
        EstimationError: the streams can't be synchronised.
        DataError: a stream is missing.
    """
    truth, headset = reference_samples(columns, reference), headset_samples(columns)
    whole = truth.trajectory()
    start, end = active_window(whole)
    # a rest that the suite asked for is part of the motion
    rests = spans(columns, "hold", truth)
    moving = whole.between(start, max([end, *rests[:, 1].tolist()]))
    estimate = headset.trajectory()
    around_s, search_s = _search(columns, headset, truth)
    fit = estimate_clock(
        moving,
        estimate,
        search_s=search_s,
        around_s=around_s,
        steps_ns=_clock_steps(columns, headset, truth),
    )
    return Synchrony(moving, PoseSpline(moving), estimate, fit)


def other_epochs(headset: Samples, truth: Samples) -> float | None:
    """How far apart [s] the stamps of two streams begin, where they count from other epochs.

    That is where one of them counts from a device's start, they lie apart by more than the ten
    minutes that are searched, and no times of arrival tell of their clocks. None where it isn't.
    """
    if not len(headset) or not len(truth) or (_has_arrivals(headset) and _has_arrivals(truth)):
        return None
    gap = max(
        int(headset.pose_t[0]) - int(truth.pose_t[-1]),
        int(truth.pose_t[0]) - int(headset.pose_t[-1]),
    )
    start = min(int(headset.pose_t[0]), int(truth.pose_t[0]))
    if gap <= MAX_SEARCH_S * NS or start >= FIRST_DATE_S * NS:
        return None
    return (int(headset.pose_t[0]) - int(truth.pose_t[0])) / NS


def _has_arrivals(samples: Samples) -> bool:
    return not np.array_equal(samples.receive_t, samples.pose_t)


def _search(columns: Columns, headset: Samples, truth: Samples) -> tuple[float, float | None]:
    """Where the search for the offset is centred and how far it reaches [s]; None for the usual."""
    apart_s = other_epochs(headset, truth)
    if apart_s is not None:
        return apart_s, None
    loop_s = loop_duration_s(columns)
    reach_s = None if loop_s is None else SEARCH_SHARE * loop_s
    return _behind(headset) - _behind(truth), reach_s


def loop_duration_s(columns: Columns) -> float | None:
    """How long one loop of the motion takes [s]; None of a take that isn't looped."""
    starts = [e.t for e in columns.events if e.kind == "loop" and e.detail.get("at") == "start"]
    return float(np.median(np.diff(starts))) / NS if len(starts) > 1 else None


def _behind(samples: Samples) -> float:
    """The median of pose time minus time of arrival [s]."""
    return float(np.median(samples.pose_t - samples.receive_t)) / NS if len(samples) else 0.0


def _clock_steps(columns: Columns, headset: Samples, truth: Samples) -> list[int]:
    """When, on the headset's clock [ns], the host's clock was set and the offset followed.

    The recorder tells every step of the host's clock, but only some streams are stamped by it; the
    others go on as they did beside their times of arrival.
    """
    steps = []
    for event in columns.events:
        if event.kind != "host-clock-step":
            continue
        size_s = float(event.detail.get("seconds", 0.0))
        before, after = (
            _behind(_arrived(headset, *span)) - _behind(_arrived(truth, *span))
            for span in ((event.t - ARRIVALS_S * NS, event.t), (event.t, event.t + ARRIVALS_S * NS))
        )
        later = headset.pose_t[headset.receive_t >= event.t]
        if abs(after - before) > 0.5 * abs(size_s) > 0.0 and len(later):
            steps.append(int(later[0]))
    return steps


def _arrived(samples: Samples, start_ns: float, end_ns: float) -> Samples:
    return samples[(samples.receive_t >= start_ns) & (samples.receive_t < end_ns)]
