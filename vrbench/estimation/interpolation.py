"""Interpolation of the reference: one cubic spline of position and rotation, never across a gap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vrbench.clocks import ClockMap
from vrbench.errors import EstimationError
from vrbench.estimation.checks import require_poses
from vrbench.geometry import (
    Bools,
    Floats,
    Ints,
    Transform,
    continuous_signs,
    quat_conjugate,
    quat_multiply,
)
from vrbench.trajectory import MAX_GAP_PERIODS, NS, Trajectory, seconds_since

# Stamps much closer than the period are jitter of the clock that stamped them; a spline through
# both samples would invent speeds.
MIN_STEP_PERIODS = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Poses and their rates.

    Attributes:
        p: positions (m, 3) [m].
        q: unit quaternions (m, 4).
        v: velocities (m, 3) [m/s], in the parent frame.
        w: angular velocities (m, 3) [rad/s], in the moving frame.
    """

    p: Floats
    q: Floats
    v: Floats
    w: Floats


class PoseSpline:
    """A trajectory between its samples: cubic, twice differentiable, undefined within gaps.

    Positions and sign-continuous quaternions are splined by components; the quaternion is then
    normalised, which keeps the order of the error (fourth in the period) and gives the angular
    velocity w as 2 q^-1 dq/dt.

    Args:
        trajectory: the poses, 2 or more.

    Raises:
        EstimationError: fewer than two poses, values not finite.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        require_poses(trajectory, "reference", 2)
        self.origin_ns = int(trajectory.t[0])
        nodes = trajectory[_nodes(trajectory)]
        self._t = nodes.t
        self._max_gap_ns = MAX_GAP_PERIODS * nodes.period_s * NS
        if not np.any(np.diff(nodes.t) <= self._max_gap_ns):
            raise EstimationError("every interval is a gap", field="reference")
        self._spline = _piecewise(nodes, self.origin_ns, self._max_gap_ns)

    def covers(self, t: Ints, margin_ns: int = 0) -> Bools:
        """Where times t (m,) [ns] lie within the trajectory, `margin_ns` or more from any gap."""
        covered = self._inside(t)
        if margin_ns:
            covered &= self._inside(t - margin_ns) & self._inside(t + margin_ns)
        return covered

    def at(self, t: Ints) -> Transform:
        """Poses at times t (m,) [ns]; NaN where `covers` is false."""
        motion = self.motion(seconds_since(t, self.origin_ns))
        return Transform(motion.p, motion.q)

    def motion(self, s: Floats) -> Motion:
        """Poses and rates at times s (m,) [s] after `origin_ns`; NaN within gaps and outside."""
        value, rate = self._spline(s), self._spline(s, 1)
        raw, raw_rate = value[:, 3:], rate[:, 3:]
        squared = np.einsum("ij,ij->i", raw, raw)[:, None]
        w = 2.0 * quat_multiply(quat_conjugate(raw), raw_rate)[:, :3] / squared
        return Motion(value[:, :3], raw / np.sqrt(squared), rate[:, :3], w)

    def _inside(self, t: Ints) -> Bools:
        left = np.clip(np.searchsorted(self._t, t, side="right") - 1, 0, len(self._t) - 2)
        within = (t >= self._t[0]) & (t <= self._t[-1])
        return within & (self._t[left + 1] - self._t[left] <= self._max_gap_ns)


def paired(
    reference: Trajectory | PoseSpline, estimate: Trajectory, clock: ClockMap
) -> tuple[Bools, Transform]:
    """The reference's poses at the times of the estimate's.

    Returns:
        Which of the estimate's poses (n,) have a reference, and the reference's poses (m,) there.

    Raises:
        EstimationError: none has one.
    """
    spline = reference if isinstance(reference, PoseSpline) else PoseSpline(reference)
    t = clock.to_reference(estimate.t)
    covered = spline.covers(t)
    if not covered.any():
        raise EstimationError(
            "no pose of the estimate lies within the reference's time",
            fix="estimate the clock of these two streams first",
        )
    return covered, spline.at(t[covered])


def _nodes(trajectory: Trajectory) -> Bools:
    """Which samples (n,) the spline passes through: all but those stamped too close to the last."""
    keep = np.ones(len(trajectory), dtype=bool)
    smallest = MIN_STEP_PERIODS * trajectory.period_s * NS
    if not np.any(np.diff(trajectory.t) < smallest):
        return keep
    last = trajectory.t[0]
    for i, t in enumerate(trajectory.t[1:].tolist(), start=1):
        keep[i] = t - last >= smallest
        if keep[i]:
            last = t
    return keep


def _piecewise(nodes: Trajectory, origin_ns: int, max_gap_ns: float) -> Any:
    """One scipy PPoly (7 columns) over all stretches without a gap, NaN in the gaps."""
    from scipy.interpolate import CubicSpline, PPoly

    s = nodes.seconds(origin_ns)
    values = np.hstack((nodes.pose.p, continuous_signs(nodes.pose.q)))
    ends = np.flatnonzero(np.diff(nodes.t) > max_gap_ns)
    if not len(ends):
        whole = CubicSpline(s, values)
        if len(whole.c) == 4:  # of hours, these are half a gigabyte: not to be copied
            return PPoly.construct_fast(whole.c, whole.x, extrapolate=False)
    coefficients = np.full((4, len(s) - 1, values.shape[1]), np.nan)
    for first, last in zip([0, *(ends + 1)], [*ends, len(s) - 1], strict=True):
        if last > first:
            piece = CubicSpline(s[first : last + 1], values[first : last + 1])
            coefficients[4 - len(piece.c) :, first:last] = piece.c
            coefficients[: 4 - len(piece.c), first:last] = 0.0
    return PPoly(coefficients, s, extrapolate=False)
