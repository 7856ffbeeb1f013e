"""Forward kinematics and Jacobian of an arm from its DH parameters, in columns of numpy."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vrbench.geometry import Floats, Transform
from vrbench_ur.arms import Dh


def link_frames(q: Floats, dh: Dh) -> Floats:
    """DH frames 0..6 in base, as matrices (..., 7, 4, 4), of joint angles (..., 6) [rad]."""
    q = np.asarray(q, dtype=np.float64)
    frames = np.empty((*q.shape[:-1], 7, 4, 4))
    frames[..., 0, :, :] = np.eye(4)
    c, s = np.cos(q + dh.theta), np.sin(q + dh.theta)
    ca, sa = np.cos(dh.alpha), np.sin(dh.alpha)
    step = np.zeros((*q.shape[:-1], 4, 4))
    step[..., 3, 3] = 1.0
    for i in range(6):
        step[..., 0, 0], step[..., 0, 1] = c[..., i], -s[..., i] * ca[i]
        step[..., 0, 2], step[..., 0, 3] = s[..., i] * sa[i], dh.a[i] * c[..., i]
        step[..., 1, 0], step[..., 1, 1] = s[..., i], c[..., i] * ca[i]
        step[..., 1, 2], step[..., 1, 3] = -c[..., i] * sa[i], dh.a[i] * s[..., i]
        step[..., 2, 1], step[..., 2, 2], step[..., 2, 3] = sa[i], ca[i], dh.d[i]
        frames[..., i + 1, :, :] = frames[..., i, :, :] @ step
    return frames


def flange(q: Floats, dh: Dh) -> Transform:
    """`T_base_flange` (...) of joint angles (..., 6) [rad]."""
    return Transform.from_matrix(link_frames(q, dh)[..., 6, :, :])


def flange_once(q: Sequence[float], dh: Dh) -> tuple[list[list[float]], list[float]]:
    """Rotation and position of the flange in base, of one posture; for one, floats are quicker.

    Args:
        q: six joint angles [rad].
        dh: of the arm.
    """
    r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    p = [0.0, 0.0, 0.0]
    for i in range(6):
        c, s = math.cos(q[i] + dh.theta[i]), math.sin(q[i] + dh.theta[i])
        ca, sa = math.cos(dh.alpha[i]), math.sin(dh.alpha[i])
        a, d = float(dh.a[i]), float(dh.d[i])
        for k in range(3):
            x, y, z = r[k]
            along = c * x + s * y
            across = c * y - s * x
            p[k] += a * along + d * z
            r[k] = [along, ca * across + sa * z, ca * z - sa * across]
    return r, p


def jacobian(q: Floats, dh: Dh, tool: Floats | None = None) -> Floats:
    """Geometric Jacobians (..., 6, 6) in base: rows are velocity [m] and turning [rad].

    Args:
        q: joint angles (..., 6) [rad].
        dh: of the arm.
        tool: the point in the flange's frame (3,) [m] whose velocity is meant; the flange's origin.
    """
    frames = link_frames(q, dh)
    point = frames[..., 6, :3, 3]
    if tool is not None:
        point = point + frames[..., 6, :3, :3] @ tool
    axes = frames[..., :6, :3, 2]
    arms = point[..., None, :] - frames[..., :6, :3, 3]
    return np.concatenate((np.cross(axes, arms), axes), axis=-1).swapaxes(-1, -2)
