"""A rigid body's poses from its markers alone, as files have them that hold nothing else.

Public to the authors of plugins. The body's frame is made of the markers themselves, so that two
takes with the same markers have the same frame: its origin is their centroid, x points from the
first marker to the second, and the third lies in the xy plane, on the side of +y.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from vrbench.errors import DataError
from vrbench.geometry import Bools, Floats, Transform, matrix_to_quat

ROUNDS = 3
LEAST_PART = 0.5
"""Of the frames in which all markers are seen, so many must agree in the shape."""
LEAST_SINE = 0.2
"""Three markers whose triangle is flatter than this make no frame."""


@dataclass(frozen=True, slots=True, eq=False)
class MarkerBody:
    """A body fitted to its markers.

    Attributes:
        shape: markers (k, 3) from the body's origin [m].
        pose: `T_room_body` (n,); the identity where it isn't seen.
        seen: in which frames (n,) three markers or more agree with the shape.
        residual_m: rms of the markers about the shape, each frame (n,) [m]; NaN where not seen.
    """

    shape: Floats
    pose: Transform
    seen: Bools
    residual_m: Floats


def fit_body(markers: Floats, *, tolerance_m: float, file: Path) -> MarkerBody:
    """The body that carries all the markers.

    Shape and poses are found in turns (generalised Procrustes analysis, Gower, 1975); a pose is the
    least-squares fit of the shape to the markers seen (Kabsch, 1976). A frame whose markers miss
    the shape by more than the tolerance, as where two were taken for each other, is not seen.

    Args:
        markers: positions (n, k, 3) in the room [m]; NaN where a marker isn't seen.
        tolerance_m: largest rms of a frame's markers about the shape [m].
        file: named in errors.

    Raises:
        DataError: fewer than three markers, all on a line, or never seen together.
    """
    if markers.shape[1] < 3:
        raise DataError(f"has {markers.shape[1]} markers: a body needs three", file=file)
    there: Bools = np.all(np.isfinite(markers), axis=2)
    complete = np.all(there, axis=1)
    whole = np.flatnonzero(complete)
    if not len(whole):
        raise DataError(
            "its markers are never all seen at once",
            file=file,
            field="markers",
            fix="name those that are on the body and are seen together",
        )
    shape = _in_own_frame(_middle(markers[whole]), file)
    for _ in range(ROUNDS):
        turn, shift, residual = _poses(shape, markers, there)
        good = np.flatnonzero(complete & (residual < tolerance_m))
        if len(good) < LEAST_PART * len(whole):
            raise DataError(
                f"its markers don't keep their distances within {tolerance_m * 1e3:g} mm",
                file=file,
                field="markers",
                fix="name those that are on one rigid body",
            )
        own = np.einsum("nji,nkj->nki", turn[good], markers[good] - shift[good, None])
        shape = _in_own_frame(own.mean(axis=0), file)
    turn, shift, residual = _poses(shape, markers, there)
    seen = residual < tolerance_m
    turn[~seen], shift[~seen] = np.eye(3), 0.0
    return MarkerBody(shape, Transform(shift, matrix_to_quat(turn)), seen, residual)


def _middle(markers: Floats) -> Floats:
    """The frame (k, 3) whose distances between markers are nearest to the median of all frames."""
    pairs = np.array(list(combinations(range(markers.shape[1]), 2)))
    apart = np.linalg.norm(markers[:, pairs[:, 0]] - markers[:, pairs[:, 1]], axis=2)
    return markers[np.argmin(np.abs(apart - np.median(apart, axis=0)).sum(axis=1))]


def _in_own_frame(points: Floats, file: Path) -> Floats:
    """Points (k, 3) in the frame that they make."""
    centred = points - points.mean(axis=0)
    for a, b, c in combinations(range(len(points)), 3):
        x, side = centred[b] - centred[a], centred[c] - centred[a]
        z = np.cross(x, side)
        if np.linalg.norm(z) > LEAST_SINE * np.linalg.norm(x) * np.linalg.norm(side):
            axes = np.stack((x, np.cross(z, x), z))
            return centred @ (axes / np.linalg.norm(axes, axis=1, keepdims=True)).T
    raise DataError("its markers lie on a line", file=file, field="markers")


def _poses(shape: Floats, markers: Floats, there: Bools) -> tuple[Floats, Floats, Floats]:
    """Rotations (n, 3, 3), origins (n, 3), residuals (n,): NaN with fewer than three markers."""
    weight = there.astype(np.float64)[..., None]
    count = np.maximum(weight.sum(axis=1), 1.0)
    known = np.where(there[..., None], markers, 0.0)
    here = (weight * shape).sum(axis=1) / count
    mid = known.sum(axis=1) / count
    a = (shape - here[:, None]) * weight
    b = (known - mid[:, None]) * weight
    u, s, vt = np.linalg.svd(np.einsum("nki,nkj->nij", b, a))
    sign = np.where(np.linalg.det(u @ vt) < 0.0, -1.0, 1.0)
    u[:, :, 2] *= sign[:, None]
    turn = u @ vt
    shift = mid - np.einsum("nij,nj->ni", turn, here)
    off = known - (np.einsum("nij,kj->nki", turn, shape) + shift[:, None])
    residual = np.sqrt((weight * off**2).sum(axis=(1, 2)) / count[:, 0])
    # two points, or several on a line, leave a turn open
    enough = (there.sum(axis=1) >= 3) & (s[:, 1] > LEAST_SINE**2 * s[:, 0])
    return turn, shift, np.where(enough, residual, np.nan)
