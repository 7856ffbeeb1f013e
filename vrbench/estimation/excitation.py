"""Excitation: whether a motion turns enough to determine a mounting transform."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vrbench.errors import EstimationError
from vrbench.estimation.checks import require_finite_rows
from vrbench.geometry import (
    Floats,
    mean_rotation,
    quat_conjugate,
    quat_multiply,
    quat_normalize,
    quat_to_rotvec,
)

MINIMUM_SPREAD_DEG = 3.0
_AXIS_NAMES = ("x", "y", "z")


@dataclass(frozen=True, slots=True, eq=False)
class Excitation:
    """How far a motion turns, and about what.

    Attributes:
        spread_deg: the central 95 % range (3,) [deg] of the rotation vectors about the mean
            rotation, along their principal axes, largest first.
        axes: those axes (3, 3), unit vectors as rows, in the moving frame at its mean rotation.
    """

    spread_deg: Floats
    axes: Floats

    @property
    def text(self) -> str:
        """`96 deg about z, 17 deg about x, ...`, each axis by its largest component."""
        return ", ".join(
            f"{spread:.1f} deg about {_axis_name(axis)}"
            for spread, axis in zip(self.spread_deg, self.axes, strict=True)
        )


def check_excitation(q: Floats, *, minimum_deg: float = MINIMUM_SPREAD_DEG) -> Excitation:
    """The excitation of rotations (n, 4), if they determine a mounting transform.

    The equation A X = Y B leaves part of X free unless the motion turns about two axes
    that are not parallel (Tsai and Lenz, 1989); a third axis adds nothing but accuracy.

    Raises:
        EstimationError: fewer than three rotations, values not finite, or rotation by less than
            `minimum_deg` about a second axis; the message says which are missing.
    """
    if len(q) < 3:
        raise EstimationError(f"only {len(q)} rotations", fix="at least 3 are needed")
    require_finite_rows(q, "rotation", "quaternion")
    q = quat_normalize(q)
    turned = quat_to_rotvec(quat_multiply(quat_conjugate(mean_rotation(q)), q))
    centred = turned - np.median(turned, axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    low, high = np.percentile(centred @ axes, (2.5, 97.5), axis=0)
    order = np.argsort(low - high)
    excitation = Excitation(np.degrees(high - low)[order], axes.T[order])
    if excitation.spread_deg[1] < minimum_deg:
        raise EstimationError(_missing(excitation, minimum_deg), fix=_fix(minimum_deg))
    return excitation


def _missing(found: Excitation, minimum_deg: float) -> str:
    if found.spread_deg[0] < minimum_deg:
        return f"the motion does not turn ({found.text}): the mounting can't be determined"
    # the two directions across the axis are noise; only the axis itself has a name
    axis = _axis_name(found.axes[0])
    lacking = " and ".join(sorted({*_AXIS_NAMES} - {axis})) if axis in _AXIS_NAMES else "any other"
    return (
        f"the motion turns about one axis only ({found.spread_deg[0]:.1f} deg about {axis}, "
        f"{found.spread_deg[1]:.1f} deg across it): rotation about {lacking} is missing, so the "
        f"mounting along {axis} can't be determined"
    )


def _fix(minimum_deg: float) -> str:
    return f"turn by {minimum_deg:g} deg or more about at least two axes"


def _axis_name(axis: Floats) -> str:
    """The moving frame's axis if it is within 20 deg of one, else the components."""
    largest = int(np.argmax(np.abs(axis)))
    if abs(axis[largest]) > np.cos(np.radians(20.0)):
        return _AXIS_NAMES[largest]
    axis = axis * np.sign(axis[largest])
    return "(" + ", ".join(f"{c:.2f}" for c in axis) + ")"
