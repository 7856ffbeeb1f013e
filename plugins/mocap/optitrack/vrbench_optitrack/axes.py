"""Axes: Motive streams with y or with z up; inside, y is up, as in OpenXR.

Motive's own z-up is (x, -z, y) of its y-up, of positions and of the vector part of quaternions
alike, so a body's own axes change with the room's, and its markers' offsets too.
"""

from __future__ import annotations

from typing import Literal

from vrbench.geometry import Z_UP, Floats, Transform

Up = Literal["y", "z"]


def to_y_up(vectors: Floats, up: Up) -> Floats:
    """Vectors (..., 3) of a stream whose `up` axis is up, with y up."""
    return vectors if up == "y" else Z_UP.points_to_openxr(vectors)


def from_y_up(vectors: Floats, up: Up) -> Floats:
    """The inverse of `to_y_up`."""
    return vectors if up == "y" else Z_UP.points_from_openxr(vectors)


def pose_to_y_up(pose: Transform, up: Up) -> Transform:
    """Poses (...) of a stream whose `up` axis is up, with y up in room and body."""
    return pose if up == "y" else Z_UP.to_openxr(pose)


def pose_from_y_up(pose: Transform, up: Up) -> Transform:
    """The inverse of `pose_to_y_up`."""
    return pose if up == "y" else Z_UP.from_openxr(pose)
