"""Axes: Motive streams with y or with z up; inside, y is up, as in OpenXR.

Motive's own z-up is (x, -z, y) of its y-up, of positions and of the vector part of quaternions
alike, so a body's own axes change with the room's, and its markers' offsets too.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from vrbench.geometry import Floats, Transform

Up = Literal["y", "z"]


def to_y_up(vectors: Floats, up: Up) -> Floats:
    """Vectors (..., 3) of a stream whose `up` axis is up, with y up."""
    if up == "y":
        return vectors
    return np.stack((vectors[..., 0], vectors[..., 2], -vectors[..., 1]), axis=-1)


def from_y_up(vectors: Floats, up: Up) -> Floats:
    """The inverse of `to_y_up`."""
    if up == "y":
        return vectors
    return np.stack((vectors[..., 0], -vectors[..., 2], vectors[..., 1]), axis=-1)


def pose_to_y_up(pose: Transform, up: Up) -> Transform:
    """Poses (...) of a stream whose `up` axis is up, with y up in room and body."""
    q = np.concatenate((to_y_up(pose.q[..., :3], up), pose.q[..., 3:]), axis=-1)
    return Transform(to_y_up(pose.p, up), q)


def pose_from_y_up(pose: Transform, up: Up) -> Transform:
    """The inverse of `pose_to_y_up`."""
    q = np.concatenate((from_y_up(pose.q[..., :3], up), pose.q[..., 3:]), axis=-1)
    return Transform(from_y_up(pose.p, up), q)
