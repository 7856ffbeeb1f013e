"""A scored take as curves: its errors by time, path, speed and frequency, thinned for display."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Ints, Transform
from vrbench.metrics.compared import MM, Compared, aligned, at_samples
from vrbench.metrics.scored import ScoredTake
from vrbench.results.plot_data import (
    BySpeed,
    ErrorCurves,
    LoopCurves,
    Mark,
    Packed,
    Spectrum,
    TakeCurves,
    few,
)
from vrbench.results.record import TakeRecord
from vrbench.results.spectrum import spectrum
from vrbench.statistics.uncertainty import error_vectors
from vrbench.streams import Event
from vrbench.trajectory import LATE_PERIODS, NS, Trajectory, distinct

# Lengths of a bin that a reader can make sense of [s].
BINS_S = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0)
QUANTILES = 101
SPEED_CLASSES = 16
MOST_MARKS = 300
LOOP_BINS = 200
# Events that tell of the recording, and not of what the headset did.
UNSEEN = frozenset(
    {
        "phase",
        "body",
        "server",
        "pose-time",
        "utc",
        "repair",
        "headset",
        "loop",
        "hold",
        "opening",
        "cue",
    }
)


def take_curves(
    record: TakeRecord,
    whole: ScoredTake,
    parts: Mapping[str, ScoredTake],
    reference: str,
    bins: int,
) -> TakeCurves:
    """The curves of a take.

    Args:
        record: the take's.
        whole: the take made ready.
        parts: the same by epoch, `all` where there is one.
        reference: what it was scored against.
        bins: how many bins of time there may be.
    """
    start = int(whole.reference.t[0])
    duration_s = whole.reference.duration_s
    bin_s = next((b for b in BINS_S if duration_s <= b * bins), duration_s / bins)
    scored = [part for part in parts.values() if part.x is not None]
    ready = scored or [whole]
    grid = _Grid(start, bin_s, max(1, int(np.ceil(duration_s / bin_s))))
    truth = _truth(ready)
    errors, by_speed, spectrum = _errors(scored, grid)
    speed = at_samples(truth.speed()) if len(truth) > 1 else np.zeros(len(truth))
    steps = np.linalg.norm(np.diff(truth.pose.p, axis=0, prepend=truth.pose.p[:1]), axis=1)
    return TakeCurves(
        take=record.name,
        case=record.case,
        condition=record.condition,
        mount=record.mount,
        repeat=record.repeat,
        role=record.role,
        reference=reference,
        duration_s=duration_s,
        bin_s=bin_s,
        samples=len(truth),
        point="eye" if scored else "tcp",
        truth=[Packed.of(grid.first(truth.t, column)) for column in truth.pose.p.T],
        travelled=Packed.of(grid.first(truth.t, np.cumsum(steps))),
        speed=Packed.of(grid.mean(truth.t, speed)),
        errors=errors,
        by_speed=by_speed,
        spectrum=spectrum,
        missing=_missing(whole),
        marks=_marks(whole),
        clock=_clock(whole),
        loops=_loops(whole, scored),
    )


class _Grid:
    """Bins of time from a start: of `bin_s` seconds each."""

    def __init__(self, start: int, bin_s: float, count: int) -> None:
        self.start, self.bin_s, self.count = start, bin_s, count

    def bins(self, t: Ints) -> Ints:
        """The bin (n,) of each stamp (n,) [ns]."""
        bins: Ints = ((t - self.start) / (self.bin_s * NS)).astype(np.int64)
        return np.clip(bins, 0, self.count - 1)

    def mean(self, t: Ints, values: Floats) -> Floats:
        """The mean (count,) in each bin; NaN where there is none."""
        at = self.bins(t)
        n = np.bincount(at, minlength=self.count)
        total = np.bincount(at, values, minlength=self.count)
        return np.where(n > 0, total / np.maximum(n, 1), np.nan)

    def max(self, t: Ints, values: Floats) -> Floats:
        """The largest (count,) in each bin; NaN where there is none."""
        largest = np.full(self.count, -np.inf)
        np.maximum.at(largest, self.bins(t), values)
        return np.where(np.isfinite(largest), largest, np.nan)

    def first(self, t: Ints, values: Floats) -> Floats:
        """The first (count,) in each bin; NaN where there is none."""
        found, at = np.unique(self.bins(t), return_index=True)
        firsts = np.full(self.count, np.nan)
        firsts[found] = values[at]
        return firsts


def _truth(parts: Sequence[ScoredTake]) -> Trajectory:
    """Where the eye truly was, or the tcp where X is unknown, at the headset's stamps."""
    t = np.concatenate([part.estimate.t for part in parts])
    poses = [part.truth if part.x is None else part.truth @ part.x for part in parts]
    t, first = np.unique(t, return_index=True)
    return Trajectory(t, Transform.concatenate(poses)[first])


def _errors(
    parts: Sequence[ScoredTake], grid: _Grid
) -> tuple[dict[str, ErrorCurves], BySpeed | None, Spectrum | None]:
    """The errors of all epochs together, as evaluation has them: each aligned by itself."""
    vectors: dict[str, list[tuple[Ints, Floats]]] = {}
    speeds: list[Floats] = []
    for part in parts:
        try:
            found = {(metric.split(".")[1], point): e for (metric, point), e in error_vectors(part)}
            eye = next(aligned(part))
        except EstimationError:
            continue  # an epoch too short to be aligned has no errors to draw
        for name, key in NAMES.items():
            vectors.setdefault(name, []).append((part.estimate.t, found[key]))
        speeds.append(_speed(part, eye))
    if not vectors:
        return {}, None, None
    together = {
        name: (np.concatenate([t for t, _ in some]), np.concatenate([e for _, e in some]))
        for name, some in vectors.items()
    }
    curves = {name: _curves(name, t, error, grid) for name, (t, error) in together.items()}
    distance = np.linalg.norm(together["eye"][1], axis=1)
    longest = max(vectors["eye"], key=lambda some: len(some[0]))
    return curves, _by_speed(np.concatenate(speeds), distance), spectrum(*longest)


NAMES = {
    "eye": ("translation", "eye"),
    "tcp": ("translation", "tcp"),
    "rotation": ("rotation", "eye"),
}


def _speed(part: ScoredTake, eye: Compared) -> Floats:
    if len(part.estimate) < 2:
        return np.zeros(len(part.estimate))
    return at_samples(Trajectory(part.estimate.t, eye.truth).speed())


def _curves(name: str, t: Ints, error: Floats, grid: _Grid) -> ErrorCurves:
    size = np.linalg.norm(error, axis=1)
    return ErrorCurves(
        unit="deg" if name == "rotation" else "mm",
        rms=Packed.of(np.sqrt(grid.mean(t, size**2))),
        max=Packed.of(grid.max(t, size)),
        quantiles=few(np.quantile(size, np.linspace(0.0, 1.0, QUANTILES))),
        axes=None if name == "tcp" else [Packed.of(grid.mean(t, axis)) for axis in error.T],
    )


def _by_speed(speed: Floats, error: Floats) -> BySpeed | None:
    """Quartiles and the 95th percentile of the error in classes of speed."""
    if len(speed) < 10 * SPEED_CLASSES:
        return None
    classes = np.array_split(np.argsort(speed, kind="stable"), SPEED_CLASSES)
    quantiles = np.array([np.quantile(error[c], (0.25, 0.5, 0.75, 0.95)) for c in classes])
    return BySpeed(
        speed=few(np.array([speed[c].mean() for c in classes])),
        quartiles=[few(column) for column in quantiles.T[:3]],
        p95=few(quantiles[:, 3]),
    )


def _missing(take: ScoredTake) -> list[tuple[float, float]]:
    """Stretches [s] of the window for which no good sample stands, as coverage counts them."""
    start, end = int(take.reference.t[0]), int(take.reference.t[-1])
    every = distinct(take.samples.pose_t)
    good = distinct(take.samples.pose_t[take.samples.good])
    good = good[(good >= start) & (good <= end)]
    period = float(np.median(np.diff(every))) if len(every) > 1 else 0.0
    edges = np.concatenate(([start], good, [end]))
    late = np.flatnonzero(np.diff(edges) > LATE_PERIODS * period)
    # the longest, if there are more than can be told apart
    late = np.sort(late[np.argsort(-np.diff(edges)[late], kind="stable")[:MOST_MARKS]])
    return [
        (round((int(edges[k]) - start) / NS, 4), round((int(edges[k + 1]) - start) / NS, 4))
        for k in late
    ]


def _marks(take: ScoredTake) -> list[Mark]:
    """Events within the window that say what became of the headset, and new world frames."""
    start, end = int(take.reference.t[0]), int(take.reference.t[-1])
    marks = [
        Mark(t=round((event.t - start) / NS, 3), kind=_told(event))
        for event in take.events()
        if event.kind not in UNSEEN and start <= event.t <= end and event.detail.get("at") != "end"
    ]
    epoch = take.samples.epoch.astype(np.int64)
    for k in np.flatnonzero(np.diff(epoch)):
        at = (int(take.samples.pose_t[k + 1]) - start) / NS
        marks.append(Mark(t=round(at, 3), kind="new world frame"))
    return sorted(marks, key=lambda mark: mark.t)[:MOST_MARKS]


def _told(event: Event) -> str:
    """What a mark says; a gap that starts and ends is the robot's way back between loops."""
    way_back = event.kind == "gap" and "at" in event.detail
    return "way back" if way_back else event.kind[:100]


def _clock(take: ScoredTake) -> tuple[list[float], list[float]] | None:
    """How far the offset of each window of the take lies from the clock it was scored with."""
    fit = take.clock_fit
    if fit is None or not len(fit.local_t):
        return None
    t, local = fit.local_t, fit.local_ns
    apart_ms = (local - take.clock.offset_ns(t)) / 1e6
    seconds = (take.clock.to_reference(t) - int(take.reference.t[0])) / NS
    return few(seconds), few(apart_ms)


def _loops(whole: ScoredTake, parts: Sequence[ScoredTake]) -> list[LoopCurves]:
    """The first and the last loop of which the window holds nine tenths; none of fewer than two.

    The window ends with the motion, a little before the last loop's plan does.
    """
    start, end = int(whole.reference.t[0]), int(whole.reference.t[-1])
    ends: dict[object, dict[object, int]] = {}
    for event in whole.events():
        if event.kind == "loop":
            ends.setdefault(event.detail.get("number"), {})[event.detail.get("at")] = event.t
    whole_ones = [
        (number, at["start"], at["end"])
        for number, at in ends.items()
        if {"start", "end"} <= at.keys()
        and min(at["end"], end) - max(at["start"], start) > 0.9 * (at["end"] - at["start"]) > 0
    ]
    if len(whole_ones) < 2:
        return []
    curves = []
    for number, began, ended in (whole_ones[0], whole_ones[-1]):
        grid = _Grid(began, (ended - began) / NS / LOOP_BINS, LOOP_BINS)
        found = [_within(part, began, ended) for part in parts]
        t = np.concatenate([t for t, _ in found]) if found else np.zeros(0, dtype=np.int64)
        if not len(t):
            return []
        error = np.concatenate([e for _, e in found])
        curves.append(
            LoopCurves(
                name=f"loop {number}",
                duration_s=(ended - began) / NS,
                axes=[Packed.of(grid.mean(t, axis)) for axis in error.T],
            )
        )
    return curves


def _within(part: ScoredTake, began: int, ended: int) -> tuple[Ints, Floats]:
    """Stamps (n,) and error vectors (n, 3) [mm] of the eye in a stretch of a take."""
    try:
        error = MM * next(aligned(part)).translation()
    except EstimationError:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    inside = (part.estimate.t >= began) & (part.estimate.t <= ended)
    return part.estimate.t[inside], error[inside]
