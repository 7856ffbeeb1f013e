"""The noise floor: the error that the measurement alone would show of a perfect headset."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vrbench.errors import EstimationError
from vrbench.estimation.alignment import align
from vrbench.estimation.interpolation import PoseSpline
from vrbench.geometry import Floats, Transform
from vrbench.metrics.compared import MM
from vrbench.metrics.registry import Value
from vrbench.metrics.scored import ScoredTake
from vrbench.statistics.uncertainty import moved_x
from vrbench.trajectory import Trajectory

# A cubic spline errs with the fourth power of the period.
SPLINE_ORDER = 4
KEPT_POSES = 500
X_DRAWS = 40


@dataclass(frozen=True, slots=True)
class NoiseFloor:
    """Its four terms, each an rms [m]; they are independent, so their squares add up.

    Attributes:
        reference: accuracy of the reference over the motion's box, as the rig states it.
        x: what the uncertainty of X makes of the point.
        offset: what the uncertainty of the clock's offset makes of the speed.
        interpolation: what the reference does between its samples that the spline misses.
    """

    reference: float
    x: float
    offset: float
    interpolation: float

    @property
    def total(self) -> float:
        """Root of the sum of the squares [m]."""
        terms = (self.reference, self.x, self.offset, self.interpolation)
        return float(np.linalg.norm(terms))


def noise_floor(
    reference: Trajectory,
    x: Transform,
    x_draws: Transform,
    point: str,
    *,
    reference_accuracy_m: float,
    offset_sigma_s: float,
) -> NoiseFloor:
    """The floor of aligned translation errors at a point.

    Args:
        reference: `T_base_tcp` over the scored window.
        x: `T_tcp_eye`.
        x_draws: X redrawn from its covariance (m,).
        point: `eye` or `tcp`.
        reference_accuracy_m: accuracy over the motion's box [m].
        offset_sigma_s: standard deviation of the clock's offset [s].

    Raises:
        ValueError: another point.
        EstimationError: too few poses of the reference, or positions that can't be aligned.
    """
    at_point = reference if point == "tcp" else reference.mapped(lambda tcp: tcp @ x)
    speed = at_point.speed()
    if len(speed) == 0:
        raise EstimationError("the reference has no motion to state a floor for")
    return NoiseFloor(
        reference=reference_accuracy_m,
        x=x_term(reference.pose, x, x_draws, point),
        offset=offset_sigma_s * _rms(speed),
        interpolation=interpolation_term(at_point),
    )


def floor_values(
    take: ScoredTake, reference_accuracy_m: float | None, rng: np.random.Generator
) -> Iterator[Value]:
    """The floor of a take at both points, term by term; the total only where all are known.

    Args:
        take: with X and its covariance; without, there is no floor to state.
        reference_accuracy_m: as the rig states it [m]; None where it doesn't.
        rng: where the draws of X come from.
    """
    if take.x is None or take.x_covariance is None or take.offset_sigma_s is None:
        return
    dx = rng.multivariate_normal(np.zeros(6), take.x_covariance, X_DRAWS, method="eigh")
    for point in ("eye", "tcp"):
        floor = noise_floor(
            take.reference,
            take.x,
            moved_x(take.x, dx),
            point,
            reference_accuracy_m=reference_accuracy_m or 0.0,
            offset_sigma_s=take.offset_sigma_s,
        )
        terms = {"x": floor.x, "offset": floor.offset, "interpolation": floor.interpolation}
        stated = {"reference": floor.reference, "total": floor.total}
        for name, metres in {**terms, **stated}.items():
            unknown = name in stated and reference_accuracy_m is None
            yield Value(
                f"floor.{name}",
                "value",
                None if unknown else metres * MM,
                "mm",
                len(take.estimate),
                point=point,
                segment=take.segment,
                reason="the reference's accuracy isn't stated" if unknown else "",
            )


def x_term(tcp: Transform, x: Transform, draws: Transform, point: str) -> float:
    """RMS distance [m] by which wrong X move the point, after the alignment that absorbs a part.

    Args:
        tcp: `T_base_tcp` (n,); at most 500 of them are used.
        x: `T_tcp_eye`.
        draws: X redrawn from its covariance (m,).
        point: `eye` or `tcp`.

    Raises:
        ValueError: another point.
        EstimationError: positions that can't be aligned.
    """
    if point not in ("eye", "tcp"):
        raise ValueError(f"point {point!r}: eye or tcp")
    tcp = tcp[:: max(1, -(-len(tcp) // KEPT_POSES))]
    eye = tcp @ x
    squares = []
    for i in range(len(draws)):
        if point == "eye":
            right, wrong = eye.p, (tcp @ draws[i]).p
        else:
            right, wrong = tcp.p, (eye @ draws[i].inverse()).p
        left = align(right, wrong).apply(wrong) - right
        squares.append(np.mean(np.sum(left**2, axis=1)))
    return float(np.sqrt(np.mean(squares)))


def interpolation_term(trajectory: Trajectory) -> float:
    """RMS error [m] of a spline through all samples, from that of one through every other.

    Twice the period makes sixteen times the error, which can be seen at the samples left out. Noise
    of the samples doesn't shrink so; it belongs to the reference's accuracy.

    Raises:
        EstimationError: fewer than five samples, or gaps between all of them.
    """
    if len(trajectory) < 5:
        raise EstimationError(f"{len(trajectory)} samples show no error of interpolation")
    spline = PoseSpline(trajectory[::2])
    between = trajectory[1::2]
    covered = spline.covers(between.t)
    if not covered.any():
        raise EstimationError("no sample of the reference lies between two others")
    missed = spline.at(between.t[covered]).p - between.pose.p[covered]
    return _rms(np.linalg.norm(missed, axis=1)) / 2**SPLINE_ORDER


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
