"""Calibrations of a mount: what each found, when they can be believed, and how far they reach."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from vrbench.clocks import Skew
from vrbench.geometry import (
    Floats,
    Transform,
    mean_rotation,
    quat_conjugate,
    quat_multiply,
    quat_to_matrix,
    quat_to_rotvec,
    relative_angle,
)
from vrbench.statistics import NORMAL_95
from vrbench.trajectory import NS

# How far outside a calibration's box, or from its nearest rotation, a motion may go. Positions
# within a centimetre are the same place; rotations of a sampled calibration stand some degrees
# apart.
BOX_MARGIN_M = 0.01
ROTATION_MARGIN_RAD = float(np.radians(15.0))
KEPT_POSES = 500


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Where the headset sits, found from one calibration take.

    Attributes:
        take: the take's name.
        x: `T_tcp_eye`.
        y: `T_base_world`, good until the headset recentres.
        translation_residual_m: root mean square of the held residual at the eye [m].
        rotation_residual_rad: the same of the rotation [rad].
        start: when its take began and
        end: ended, by the recorder's clock [ns].
        tcp: poses `T_base_tcp` it was made of, thinned to at most 500.
        x_covariance: of X (6, 6): rotation vector in `eye` [rad], translation in `tcp` [m]; None
            where the protocol has none.
        world: names the world of `y`; None where nobody knows which it is.
        skew: of the headset's clock; None where the protocol has none.
    """

    take: str
    x: Transform
    y: Transform
    translation_residual_m: float
    rotation_residual_rad: float
    start: int
    end: int
    tcp: Transform
    x_covariance: Floats | None = None
    world: str | None = None
    skew: Skew | None = None


@dataclass(frozen=True, slots=True)
class Limits:
    """What a calibration must keep to; SI units."""

    translation_m: float
    rotation_rad: float
    max_age_s: float
    bracket_m: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """How the takes that rest on a calibration count: `ok`, or why not."""

    status: str = "ok"
    reason: str = ""


def thinned(tcp: Transform) -> Transform:
    """At most `KEPT_POSES` of the poses, evenly."""
    return tcp[:: max(1, -(-len(tcp) // KEPT_POSES))]


def mean_x(calibrations: Sequence[Calibration]) -> tuple[Transform, Floats | None]:
    """The mean of the calibrations' X, and its covariance.

    Of rotations it is the chordal mean. Calibrations that scatter by more than their covariances
    say have those stretched until they agree (Birge's ratio). None where one has no covariance.
    """
    x = Transform(
        np.mean([c.x.p for c in calibrations], axis=0),
        mean_rotation(np.array([c.x.q for c in calibrations])),
    )
    covariances = [c.x_covariance for c in calibrations if c.x_covariance is not None]
    if len(covariances) < len(calibrations):
        return x, None
    covariance = np.sum(covariances, axis=0) / len(calibrations) ** 2
    if len(calibrations) == 1:
        return x, covariance
    off = np.array([_difference(c.x, x) for c in calibrations])
    information = np.linalg.pinv(np.mean(covariances, axis=0), hermitian=True)
    chi_square = float(np.einsum("ni,ij,nj->", off, information, off))
    return x, covariance * max(1.0, chi_square / (6 * (len(calibrations) - 1)))


def mean_skew(calibrations: Sequence[Calibration]) -> Skew | None:
    """The mean skew of the calibrations, each by its certainty; None where none has one.

    What they scatter by more than they should is added, as to the mean X.
    """
    found = [c.skew for c in calibrations if c.skew is not None]
    if not found:
        return None
    weight = np.array([1.0 / skew.sigma**2 for skew in found])
    value = np.array([skew.value for skew in found])
    mean = float(np.sum(weight * value) / np.sum(weight))
    variance = 1.0 / float(np.sum(weight))
    if len(found) > 1:
        variance *= max(1.0, float(np.sum(weight * (value - mean) ** 2)) / (len(found) - 1))
    return Skew(mean, math.sqrt(variance))


def _difference(a: Transform, b: Transform) -> Floats:
    """How far a is off b (6,): a rotation vector in `eye` [rad], a translation in `tcp` [m]."""
    turn = quat_to_rotvec(quat_multiply(quat_conjugate(b.q), a.q))
    return np.concatenate((turn, a.p - b.p))


def slip(a: Calibration, b: Calibration) -> tuple[float, float]:
    """How far apart two calibrations put the eye seen from the tcp, or the tcp seen from the eye.

    Returns:
        the larger of the two distances [m], and its standard deviation by the covariances of X [m].
    """
    found = []
    for place, by_x in ((_eye, _eye_by_x), (_tcp, _tcp_by_x)):
        distance = float(np.linalg.norm(place(a.x) - place(b.x)))
        variance = 0.0
        for c in (a, b):
            if c.x_covariance is not None:
                derivative = by_x(c.x)
                variance += float(np.trace(derivative @ c.x_covariance @ derivative.T))
        found.append((distance, math.sqrt(variance)))
    return max(found)


def _eye(x: Transform) -> Floats:
    return x.p


def _eye_by_x(_x: Transform) -> Floats:
    return np.hstack((np.zeros((3, 3)), np.eye(3)))


def _tcp(x: Transform) -> Floats:
    return x.inverse().p


def _tcp_by_x(x: Transform) -> Floats:
    """Of -R^T p (3, 6): a turn dr in the eye's frame moves it by (-R^T p) x dr, dp by -R^T dp."""
    lever = _tcp(x)
    cross = np.cross(np.eye(3), lever)
    return np.hstack((-cross, -quat_to_matrix(x.q).T))


def gate(
    calibrations: Sequence[Calibration],
    own: Calibration | None,
    start: int,
    end: int,
    tcp: Transform,
    limits: Limits,
    checks: Sequence[Calibration] = (),
) -> Verdict:
    """Whether a take from start to end [ns], with poses `T_base_tcp` tcp (n,), may rest on these.

    Args:
        calibrations: of the take's mount, without the take itself.
        own: the take's own, where it is a calibration; it must agree with the others, and is
            bracketed by that agreement.
        start: when the take began, by the recorder's clock [ns].
        end: when it ended.
        tcp: its poses.
        limits: of the suite's gate.
        checks: which say, as calibrations do, that the headset didn't move on its mount.
    """
    if not calibrations:
        return Verdict("invalid", "no calibration in this mount")
    agreeing = [*calibrations, own] if own else list(calibrations)
    around = [*calibrations, *checks]
    reason = _residuals(agreeing, limits) or _age(around, start, end, limits)
    reason = reason or _agreement([*agreeing, *checks], limits)
    if reason:
        return Verdict("invalid", reason)
    before = any(c.end <= start for c in around)
    after = any(c.start >= end for c in around)
    status, notes = "ok", []
    if own is None and not (before and after):
        status = "unbracketed"
        notes.append("no calibration " + ("after" if before else "before"))
    beyond = excursion(Transform.concatenate(c.tcp for c in calibrations), tcp)
    if beyond.any_outside:
        status = "extrapolated"
        notes.append(str(beyond))
    return Verdict(status, "; ".join(notes))


def _residuals(calibrations: Sequence[Calibration], limits: Limits) -> str:
    for c in calibrations:
        if c.translation_residual_m > limits.translation_m:
            return (
                f"calibration {c.take} leaves {c.translation_residual_m * 1e3:.2f} mm, "
                f"the gate is {limits.translation_m * 1e3:g} mm"
            )
        if c.rotation_residual_rad > limits.rotation_rad:
            return (
                f"calibration {c.take} leaves {np.degrees(c.rotation_residual_rad):.3f} deg, "
                f"the gate is {np.degrees(limits.rotation_rad):.3g} deg"
            )
    return ""


def _age(calibrations: Sequence[Calibration], start: int, end: int, limits: Limits) -> str:
    age = min(max(start - c.end, c.start - end, 0) for c in calibrations) / NS
    if age <= limits.max_age_s:
        return ""
    return (
        f"the nearest calibration is {age / 60:.0f} min away, "
        f"the gate is {limits.max_age_s / 60:g} min"
    )


def _agreement(calibrations: Sequence[Calibration], limits: Limits) -> str:
    """Why calibrations disagree: by more than the gate, and than their uncertainty explains."""
    for a, b in combinations(calibrations, 2):
        apart, sigma = slip(a, b)
        chance = NORMAL_95 * sigma
        if apart - chance > limits.bracket_m:
            return (
                f"calibrations {a.take} and {b.take} differ by {apart * 1e3:.2f} mm "
                f"(+- {chance * 1e3:.2f}), the gate is {limits.bracket_m * 1e3:g} mm"
            )
    return ""


@dataclass(frozen=True, slots=True)
class Excursion:
    """How far a motion leaves what was calibrated.

    Attributes:
        share: part of the poses outside the box or away from all rotations, 0..1.
        distance_m: farthest outside the box, along one axis [m].
        angle_rad: farthest from the nearest calibrated rotation [rad].
    """

    share: float
    distance_m: float
    angle_rad: float

    @property
    def any_outside(self) -> bool:
        return self.share > 0.0

    def __str__(self) -> str:
        return (
            f"{self.share * 100:.0f} % of the motion lies outside the calibration: "
            f"by {self.distance_m * 1e3:.0f} mm, {np.degrees(self.angle_rad):.0f} deg"
        )


def excursion(calibrated: Transform, tcp: Transform) -> Excursion:
    """How far poses tcp (n,) leave the box and the rotations of poses calibrated (m,)."""
    tcp = thinned(tcp)
    low, high = calibrated.p.min(axis=0), calibrated.p.max(axis=0)
    distance: Floats = np.maximum(np.maximum(low - tcp.p, tcp.p - high), 0.0).max(axis=1)
    angle = relative_angle(tcp.q[:, None], calibrated.q[None]).min(axis=1)
    outside = (distance > BOX_MARGIN_M) | (angle > ROTATION_MARGIN_RAD)
    return Excursion(float(outside.mean()), float(distance.max()), float(angle.max()))
