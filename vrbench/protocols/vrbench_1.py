"""Protocol `vrbench-1`: clock by angular speed, X from calibration, one robust fit a take."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vrbench.clocks import ClockMap, Skew
from vrbench.errors import EstimationError
from vrbench.estimation.drift import LONG_TAKE_S
from vrbench.estimation.fit import fit
from vrbench.estimation.fitted import Fit
from vrbench.estimation.handeye import (
    refuse_other_handedness,
    residuals,
    solve_handeye,
    solve_world,
)
from vrbench.estimation.interpolation import PoseSpline, paired
from vrbench.estimation.jumps import refuse_jump
from vrbench.geometry import Floats, Transform
from vrbench.metrics.scored import ScoredTake
from vrbench.protocols.calibration import Calibration, thinned
from vrbench.protocols.protocol import (
    Protocol,
    headset_samples,
    recorded_span,
    reference_samples,
    world_of,
)
from vrbench.protocols.stretches import recorder_behind_ns
from vrbench.protocols.synchrony import synchronised
from vrbench.streams import Columns
from vrbench.trajectory import NS, Trajectory

# No headset errs so in the median; what does is a frame of another kind, or another mount.
UNLIKE_RAD = np.radians(10.0)
UNLIKE_SHARE = 0.3


def calibrate(columns: Columns, reference: str, take: str) -> Calibration:
    """X and Y of a calibration take: a linear solve, then one fit of clock, X, Y and scale.

    Skew (with its prior) and scale are fitted because wrong ones bias X, and are dropped after:
    20 ppm are 2.4 ms in two minutes, which would turn X by 0.006 deg.

    Raises:
        EstimationError: the take doesn't determine X, or the headset's world changes within it.
        DataError: a stream is missing.
    """
    epochs = headset_samples(columns).epochs
    if len(epochs) > 1:
        raise EstimationError(
            f"the headset recentred within the calibration: it has {len(epochs)} epochs"
        )
    together = synchronised(columns, reference)
    spline, estimate, clock = together.spline, together.estimate, together.clock_fit.clock
    covered, tcp = paired(spline, estimate, clock)
    refuse_jump(estimate.t[covered], tcp, estimate.pose[covered])
    start = solve_handeye(tcp, estimate.pose[covered])
    best = fit(
        spline,
        estimate,
        clock=clock,
        x=start.x,
        y=start.y,
        free=("offset", "skew", "x", "y", "scale"),
    )
    covered, tcp = paired(spline, estimate, best.clock)
    translation, rotation = residuals(tcp, estimate.pose[covered], best.x, best.y)
    began, ended = recorded_span(columns, reference)
    return Calibration(
        take=take,
        x=best.x,
        y=best.y,
        translation_residual_m=float(np.sqrt(np.mean(translation**2))),
        rotation_residual_rad=float(np.sqrt(np.mean(rotation**2))),
        start=began,
        end=ended,
        tcp=thinned(tcp),
        x_covariance=_x_covariance(best),
        world=world_of(columns),
        skew=_skew(best),
    )


def _skew(best: Fit) -> Skew:
    """What a calibration found of the clock's skew."""
    ends = best.t[[0, -1]]
    offsets = best.clock.offset_ns(ends)
    return Skew(float(np.diff(offsets)[0] / np.diff(ends)[0]), best.sigma("skew"))


def _x_covariance(best: Fit) -> Floats:
    """Of X (6, 6), from that of all that was fitted."""
    first = best.names.index("x.rx")
    part: Floats = best.covariance[first : first + 6, first : first + 6]
    return part


def prepare(
    columns: Columns,
    reference: str,
    x: Transform | None,
    *,
    anchor_s: float | None = None,
    skew: Skew | None = None,
    measured: ClockMap | None = None,
) -> ScoredTake:
    """A take on the reference's clock; with X, offset and Y are fitted, and nothing else.

    A take too short to tell a skew has that of the calibrations, and the offset's uncertainty
    takes in how well that is known.

    Raises:
        EstimationError: the streams can't be synchronised, or the eye's poses are mirrored,
            inverse, or in two frames.
        DataError: a stream is missing.
    """
    together = synchronised(columns, reference)
    moving, spline, estimate = together.moving, together.spline, together.estimate
    synchrony = together.clock_fit
    if estimate.duration_s >= LONG_TAKE_S:
        skew = None
    clock, y, sigma = measured or _gaining(synchrony.clock, skew), None, None
    if x is not None:
        free = ("y",) if measured else ("offset", "y")
        start = _world(spline, estimate, clock, x)
        known = 0.0 if measured or skew is None else skew.sigma
        best = fit(spline, estimate, clock=clock, x=x, y=start, free=free, skew_sigma=known)
        clock, y = best.clock, best.y
        sigma = None if measured else best.sigma("offset")
        middle = int(estimate.t[len(estimate) // 2])
        synchrony = replace(synchrony, clock=clock, offset_s=float(clock.offset_ns(middle)) / NS)
    covered, truth = paired(spline, estimate, clock)
    samples = headset_samples(columns)
    pose_t = clock.to_reference(samples.pose_t)
    within = (pose_t >= moving.t[0]) & (pose_t <= moving.t[-1])
    return ScoredTake(
        columns=columns,
        reference=moving,
        samples=replace(samples, pose_t=pose_t)[within],
        estimate=Trajectory(clock.to_reference(estimate.t), estimate.pose)[covered],
        truth=truth,
        clock=clock,
        x=x,
        y=y,
        anchor_end=None if anchor_s is None else int(moving.t[0]) + round(anchor_s * NS),
        clock_fit=synchrony,
        offset_sigma_s=sigma,
        recorder_behind_ns=recorder_behind_ns(reference_samples(columns, reference)),
    )


def _gaining(clock: ClockMap, skew: Skew | None) -> ClockMap:
    """A clock of constant pieces, two knots each, made to gain by the skew."""
    if skew is None:
        return clock
    ends = clock.knots.reshape(-1, 2)
    since = ends - (ends[:, :1] + (ends[:, 1:] - ends[:, :1]) // 2)
    return ClockMap(clock.knots, clock.offsets + skew.value * since.ravel())


def _world(spline: PoseSpline, estimate: Trajectory, clock: ClockMap, x: Transform) -> Transform:
    """Where Y starts; poses that no Y brings together with the reference's are looked at closely.

    Raises:
        EstimationError: the eye's poses are mirrored, inverse, or in two frames.
    """
    covered, tcp = paired(spline, estimate, clock)
    eye = estimate.pose[covered]
    y = solve_world(tcp, eye, x)
    distance, angle = residuals(tcp, eye, x, y)
    extent = np.median(np.linalg.norm(eye.p - np.median(eye.p, axis=0), axis=1))
    if np.median(angle) > UNLIKE_RAD or np.median(distance) > UNLIKE_SHARE * extent:
        refuse_other_handedness(tcp, eye)
    return y


PROTOCOL = Protocol(
    name="vrbench-1",
    title="Clock by angular speed, X from calibration, one robust fit of offset and Y a take",
    calibrate=calibrate,
    prepare=prepare,
)
