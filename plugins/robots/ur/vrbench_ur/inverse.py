"""Inverse kinematics in closed form: all eight postures of a UR arm, for any number of poses.

The three middle axes are parallel, so the first angle follows from the wrist's distance to their
plane, the fifth and sixth from the tool's turn out of it, and the rest is a planar triangle.
"""

from __future__ import annotations

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Transform, quat_conjugate, quat_multiply, quat_to_rotvec
from vrbench_ur.arms import Dh
from vrbench_ur.kinematics import flange, jacobian

BRANCHES = 8
# Poses solved at a time: what lies between stays in the processor's cache.
BLOCK = 2048
# Rounding may carry a cosine this far past 1 at the edge of reach.
EDGE = 1e-12
# sin(q5) below which axes 4 and 6 count as one line and q6 is free.
ALIGNED = 1e-10


def branch_name(branch: int) -> str:
    """Which posture a branch is, in words."""
    shoulder = "left" if branch & 4 == 0 else "right"
    wrist = "no flip" if branch & 2 == 0 else "flip"
    elbow = "up" if branch & 1 == 0 else "down"
    return f"shoulder {shoulder}, wrist {wrist}, elbow {elbow}"


def _arccos(x: Floats) -> Floats:
    """The arc cosine; NaN where there is none."""
    x = np.where(np.abs(x) <= 1.0 + EDGE, np.clip(x, -1.0, 1.0), np.nan)
    angle: Floats = np.arccos(x)
    return angle


def solve(pose: Transform, dh: Dh) -> Floats:
    """Joint angles (..., 8, 6) in -pi..pi [rad] that bring the flange to `T_base_flange` (...).

    NaN where a posture doesn't reach the pose. `dh` must be nominal: a calibrated arm's middle axes
    aren't parallel, see `refine`. Where q5 is 0 or pi, q6 is set to 0, one choice of many.
    """
    if pose.p.ndim == 2 and len(pose) > BLOCK:
        return np.concatenate([solve(pose[k : k + BLOCK], dh) for k in range(0, len(pose), BLOCK)])
    m = pose.matrix()
    d4, d5, d6 = dh.d[3], dh.d[4], dh.d[5]
    a2, a3 = dh.a[1], dh.a[2]
    q = np.empty((*m.shape[:-2], 2, 2, 2, 6))  # shoulder, wrist, elbow
    # the sign of each choice, broadcast against the poses
    shoulder = np.array([1.0, -1.0]).reshape(2, 1, 1)
    wrist = np.array([1.0, -1.0]).reshape(1, 2, 1)
    elbow = np.array([1.0, -1.0]).reshape(1, 1, 2)

    def each(x: Floats) -> Floats:
        return x[..., None, None, None]

    px, py, pz = (each(m[..., i, 3]) for i in range(3))
    r00, r01, r02 = (each(m[..., 0, i]) for i in range(3))
    r10, r11, r12 = (each(m[..., 1, i]) for i in range(3))
    r20, r21, r22 = (each(m[..., 2, i]) for i in range(3))

    wx, wy = px - d6 * r02, py - d6 * r12
    with np.errstate(divide="ignore", invalid="ignore"):
        swing = _arccos(d4 / np.hypot(wx, wy))
        q1 = np.arctan2(wy, wx) + shoulder * swing + np.pi / 2
        s1, c1 = np.sin(q1), np.cos(q1)
        # the rotation's row along z of frame 1 gives q5 and q6
        nx, ny, nz = r00 * s1 - r10 * c1, r01 * s1 - r11 * c1, r02 * s1 - r12 * c1
        # atan2 keeps its digits where the arc cosine of nz would lose them
        sine = np.hypot(nx, ny)
        q5 = wrist * np.arctan2(sine, nz)
        sign = np.sign(np.sin(q5))
        q6 = np.where(sine < ALIGNED, 0.0, np.arctan2(-sign * ny, sign * nx))
        # frame 4 in frame 1: the flange, less d6 and q6 and q5
        s5, c5, s6, c6 = np.sin(q5), np.cos(q5), np.sin(q6), np.cos(q6)
        ux = (r00 * c6 - r01 * s6, r10 * c6 - r11 * s6, r20 * c6 - r21 * s6)
        uy = (r00 * s6 + r01 * c6, r10 * s6 + r11 * c6, r20 * s6 + r21 * c6)
        z6 = (r02, r12, r22)
        # columns of frame 4 in base
        x4 = [c5 * ux[i] - s5 * z6[i] for i in range(3)]
        z4 = [-uy[i] for i in range(3)]
        ox, oy, oz = (p - d6 * z6[i] - d5 * z4[i] for i, p in enumerate((px, py, pz)))
        along, up = c1 * ox + s1 * oy, oz - dh.d[0]
        turn = np.arctan2(x4[2], c1 * x4[0] + s1 * x4[1])
        q3 = elbow * _arccos((along**2 + up**2 - a2**2 - a3**2) / (2 * a2 * a3))
        q2 = np.arctan2(up, along) - np.arctan2(a3 * np.sin(q3), a2 + a3 * np.cos(q3))
        q4 = turn - q2 - q3
    for i, angle in enumerate((q1, q2, q3, q4, q5, q6)):
        q[..., i] = angle
    q = (q + np.pi) % (2 * np.pi) - np.pi
    q[np.isnan(q).any(axis=-1)] = np.nan
    return q.reshape(*m.shape[:-2], BRANCHES, 6)


def pose_error(q: Floats, pose: Transform, dh: Dh) -> Floats:
    """What is missing to the poses (...): position [m] and rotation vector [rad], (..., 6)."""
    at = flange(q, dh)
    turn = quat_to_rotvec(quat_multiply(pose.q, quat_conjugate(at.q)))
    return np.concatenate((pose.p - at.p, turn), axis=-1)


def refine(
    q: Floats, pose: Transform, dh: Dh, *, rounds: int = 8, tolerance: float = 1e-10
) -> Floats:
    """Joint angles (n, 6) near q that reach the poses (n,) with parameters `dh`, by Newton.

    Raises:
        EstimationError: it doesn't converge: q is too far off, or singular.
    """
    for _ in range(rounds):
        error = pose_error(q, pose, dh)
        if np.abs(error).max(initial=0.0) < tolerance:
            return q
        try:
            q = q + np.linalg.solve(jacobian(q, dh), error[..., None])[..., 0]
        except np.linalg.LinAlgError:
            break
    if np.abs(pose_error(q, pose, dh)).max(initial=0.0) < tolerance:
        return q
    raise EstimationError("the arm's calibration leads through a singular posture")
