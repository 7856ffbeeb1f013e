"""Rotations and rigid transforms as columns of numpy: right-handed, metres, quaternions xyzw.

A transform named `T_parent_child` maps coordinates in `child` to coordinates in `parent`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import wraps
from typing import Any, ParamSpec

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]


# Rows of columns computed at a time: what lies between stays in the processor's cache, which makes
# products of half a million quaternions three times as fast.
BLOCK = 8192

Rows = ParamSpec("Rows")


def _in_blocks(f: Callable[Rows, Floats]) -> Callable[Rows, Floats]:
    """The same function of rows, in blocks where its arguments are long columns or single rows."""
    of_rows: Callable[..., Floats] = f

    @wraps(f)
    def blocked(*rows: Rows.args, **named: Rows.kwargs) -> Floats:
        given: list[Any] = [np.asarray(x) for x in rows]
        n = max((len(x) for x in given if x.ndim), default=0)
        if n <= BLOCK or named or any(x.ndim > 2 or (x.ndim == 2 and len(x) != n) for x in given):
            return f(*rows, **named)
        long = [x.ndim > 0 and len(x) == n for x in given]
        return np.concatenate(
            [
                of_rows(
                    *(x[k : k + BLOCK] if cut else x for x, cut in zip(given, long, strict=True))
                )
                for k in range(0, n, BLOCK)
            ]
        )

    return blocked


@_in_blocks
def quat_multiply(a: Floats, b: Floats) -> Floats:
    """The Hamilton product of quaternions (..., 4), xyzw: the rotation b, then a."""
    ax, ay, az, aw = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    bx, by, bz, bw = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    return np.stack(
        (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ),
        axis=-1,
    )


def quat_conjugate(q: Floats) -> Floats:
    """The inverse rotations of unit quaternions (..., 4)."""
    return q * np.array([-1.0, -1.0, -1.0, 1.0])


@_in_blocks
def quat_normalize(q: Floats) -> Floats:
    """Quaternions (..., 4) scaled to unit length."""
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


@_in_blocks
def quat_rotate(q: Floats, v: Floats) -> Floats:
    """Vectors (..., 3) turned by unit quaternions (..., 4)."""
    x, y, z, w = _columns(q)
    vx, vy, vz = _columns(v)
    # t = 2 q x v; v + w t + q x t
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return _rows(
        vx + w * tx + (y * tz - z * ty),
        vy + w * ty + (z * tx - x * tz),
        vz + w * tz + (x * ty - y * tx),
    )


def _columns(rows: Floats) -> Floats:
    """The components (k, ...) of rows (..., k), each of them in one piece."""
    return np.ascontiguousarray(np.moveaxis(rows, -1, 0))


def _rows(*columns: Floats) -> Floats:
    """Rows (..., k) of components; np.stack takes longer."""
    rows = np.empty((*columns[0].shape, len(columns)))
    for i, column in enumerate(columns):
        rows[..., i] = column
    return rows


@_in_blocks
def cross(a: Floats, b: Floats) -> Floats:
    """The cross product of vectors (..., 3), bit for bit np.cross in half its time."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), axis=-1)


@_in_blocks
def quat_angle(q: Floats) -> Floats:
    """Rotation angles [rad] in 0..pi of quaternions (..., 4); exact for small angles too."""
    return 2.0 * np.arctan2(np.linalg.norm(q[..., :3], axis=-1), np.abs(q[..., 3]))


@_in_blocks
def relative_angle(a: Floats, b: Floats) -> Floats:
    """Angles [rad] in 0..pi between the rotations a and b, quaternions (..., 4)."""
    return quat_angle(quat_multiply(quat_conjugate(a), b))


@_in_blocks
def quat_to_rotvec(q: Floats) -> Floats:
    """Rotation vectors (..., 3) [rad], of length 0..pi, of quaternions (..., 4)."""
    q = np.where(q[..., 3:] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., 3:])
    small = sine < 1e-12
    factor = np.where(small, 2.0, angle / np.where(small, 1.0, sine))
    return q[..., :3] * factor


@_in_blocks
def rotvec_to_quat(r: Floats) -> Floats:
    """Unit quaternions (..., 4) of rotation vectors (..., 3) [rad]."""
    half = 0.5 * np.linalg.norm(r, axis=-1, keepdims=True)
    # np.sinc(x) is sin(pi x) / (pi x), finite at zero.
    return np.concatenate((0.5 * np.sinc(half / np.pi) * r, np.cos(half)), axis=-1)


@_in_blocks
def quat_to_matrix(q: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    x, y, z, w = _columns(q)
    xx, yy, zz = x * x, y * y, z * z
    xy, xz, yz = x * y, x * z, y * z
    wx, wy, wz = x * w, y * w, z * w
    rows = _rows(
        *(1 - 2 * (yy + zz), 2 * (xy - wz), 2 * (xz + wy)),
        *(2 * (xy + wz), 1 - 2 * (xx + zz), 2 * (yz - wx)),
        *(2 * (xz - wy), 2 * (yz + wx), 1 - 2 * (xx + yy)),
    )
    return rows.reshape(*q.shape[:-1], 3, 3)


def matrix_to_quat(m: Floats) -> Floats:
    """Unit quaternions (..., 4), w >= 0, of rotation matrices (..., 3, 3).

    The largest of the four components is found first, so that nothing small is divided by
    (Shepperd, 1978).
    """
    m = np.asarray(m, dtype=np.float64)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    # four times the products of the components, one row for each choice of the largest
    wx, wy, wz = (
        m[..., 2, 1] - m[..., 1, 2],
        m[..., 0, 2] - m[..., 2, 0],
        m[..., 1, 0] - m[..., 0, 1],
    )
    xy, xz, yz = (
        m[..., 0, 1] + m[..., 1, 0],
        m[..., 0, 2] + m[..., 2, 0],
        m[..., 1, 2] + m[..., 2, 1],
    )
    candidates = np.stack(
        (
            np.stack((1 + xx - yy - zz, xy, xz, wx), axis=-1),
            np.stack((xy, 1 - xx + yy - zz, yz, wy), axis=-1),
            np.stack((xz, yz, 1 - xx - yy + zz, wz), axis=-1),
            np.stack((wx, wy, wz, 1 + xx + yy + zz), axis=-1),
        ),
        axis=-2,
    )
    largest = np.argmax(np.diagonal(candidates, axis1=-2, axis2=-1), axis=-1)
    q = quat_normalize(np.take_along_axis(candidates, largest[..., None, None], axis=-2)[..., 0, :])
    return np.where(q[..., 3:] < 0.0, -q, q)


def continuous_signs(q: Floats) -> Floats:
    """The same rotations (n, 4), signs chosen so that neighbours lie in one hemisphere."""
    if len(q) < 2:
        return q
    flips = np.where(np.einsum("ij,ij->i", q[1:], q[:-1]) < 0.0, -1.0, 1.0)
    return q * np.concatenate(([1.0], np.cumprod(flips)))[:, None]


@_in_blocks
def slerp(q0: Floats, q1: Floats, u: Floats) -> Floats:
    """Spherical interpolation along the shorter arc between quaternions (..., 4), u in 0..1."""
    u = np.asarray(u)[..., None]
    dot = np.sum(q0 * q1, axis=-1, keepdims=True)
    q1 = np.where(dot < 0.0, -q1, q1)
    # atan2 of difference and sum stays exact where arccos of the dot product does not
    angle = 2.0 * np.arctan2(
        np.linalg.norm(q1 - q0, axis=-1, keepdims=True),
        np.linalg.norm(q1 + q0, axis=-1, keepdims=True),
    )
    sine = np.sin(angle)
    near = sine < 1e-9
    divisor = np.where(near, 1.0, sine)
    w0 = np.where(near, 1.0 - u, np.sin((1.0 - u) * angle) / divisor)
    w1 = np.where(near, u, np.sin(u * angle) / divisor)
    return quat_normalize(w0 * q0 + w1 * q1)


def mean_rotation(q: Floats) -> Floats:
    """The mean (4,) of rotations (n, 4): the chordal L2 mean (Markley et al., 2007)."""
    _, vectors = np.linalg.eigh(q.T @ q)
    mean: Floats = vectors[:, -1]
    return -mean if mean[3] < 0 else mean


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """Rigid transforms `T_parent_child`, one or many.

    Attributes:
        p: translations (..., 3) [m].
        q: unit quaternions (..., 4), xyzw.
    """

    p: Floats
    q: Floats

    @classmethod
    def identity(cls) -> Transform:
        return cls(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))

    @classmethod
    def of(cls, p: npt.ArrayLike, q: npt.ArrayLike) -> Transform:
        """From anything array-like; the quaternions are normalised."""
        return cls(np.asarray(p, dtype=np.float64), quat_normalize(np.asarray(q, dtype=np.float64)))

    @classmethod
    def from_matrix(cls, m: npt.ArrayLike) -> Transform:
        """From homogeneous matrices (..., 4, 4) or (..., 3, 4)."""
        m = np.asarray(m, dtype=np.float64)
        return cls(m[..., :3, 3], matrix_to_quat(m[..., :3, :3]))

    @classmethod
    def concatenate(cls, parts: Iterable[Transform]) -> Transform:
        parts = list(parts)
        return cls(np.concatenate([x.p for x in parts]), np.concatenate([x.q for x in parts]))

    def matrix(self) -> Floats:
        """Homogeneous matrices (..., 4, 4)."""
        m = np.zeros((*self.p.shape[:-1], 4, 4))
        m[..., :3, :3] = quat_to_matrix(self.q)
        m[..., :3, 3] = self.p
        m[..., 3, 3] = 1.0
        return m

    def __matmul__(self, other: Transform) -> Transform:
        """`T_a_b @ T_b_c` is `T_a_c`; one against many is broadcast."""
        return Transform(quat_rotate(self.q, other.p) + self.p, quat_multiply(self.q, other.q))

    def apply(self, points: Floats) -> Floats:
        """Points (..., 3) in the child frame, in coordinates of the parent frame."""
        return quat_rotate(self.q, points) + self.p

    def inverse(self) -> Transform:
        q = quat_conjugate(self.q)
        return Transform(-quat_rotate(q, self.p), q)

    def __len__(self) -> int:
        return len(self.p)

    def __getitem__(self, index: Any) -> Transform:
        return Transform(self.p[index], self.q[index])


@dataclass(frozen=True, slots=True)
class Axes:
    """How somebody else writes poses: which way the axes point, and the unit of length.

    Axes are named as `x`, `-x`, `y` ...; both the parent's and the child's point so. A pose of
    another convention is the same motion written in other coordinates: with M the signed
    permutation from theirs to ours, p' = M p, R' = M R M^T, hence q' = (det(M) M q_xyz, q_w).

    Attributes:
        up: the axis against gravity.
        forward: the axis of sight.
        handedness: `right` or `left`.
        unit_m: the unit of length [m].
    """

    up: str
    forward: str
    handedness: str = "right"
    unit_m: float = 1.0

    def __post_init__(self) -> None:
        if self.handedness not in ("right", "left"):
            raise ValueError(f"handedness is right or left, not {self.handedness!r}")
        if np.dot(_axis(self.up), _axis(self.forward)) != 0.0:
            raise ValueError(f"up {self.up!r} and forward {self.forward!r} are one line")

    def to_openxr(self, pose: Transform) -> Transform:
        """Poses written so, in OpenXR's convention: right-handed, y up, -z forward, metres."""
        order, signs = self._permutation()
        return Transform(self.points_to_openxr(pose.p), self._rotated(pose.q, order, signs))

    def points_to_openxr(self, points: Floats) -> Floats:
        """The same of points (..., 3)."""
        order, signs = self._permutation()
        return points[..., order] * (signs * self.unit_m)

    def from_openxr(self, pose: Transform) -> Transform:
        """Poses in OpenXR's convention, written so."""
        order, signs = self._permutation()
        back = np.argsort(order)
        return Transform(self.points_from_openxr(pose.p), self._rotated(pose.q, back, signs[back]))

    def points_from_openxr(self, points: Floats) -> Floats:
        """The same of points (..., 3)."""
        order, signs = self._permutation()
        back = np.argsort(order)
        return points[..., back] * (signs[back] / self.unit_m)

    def _rotated(self, q: Floats, order: Ints, signs: Floats) -> Floats:
        hand = 1.0 if self.handedness == "right" else -1.0
        return q[..., [*order, 3]] * np.append(signs * hand, 1.0)

    def _permutation(self) -> tuple[Ints, Floats]:
        """Which coordinates are right, up and backward (3,), and their signs (3,)."""
        up, forward = _axis(self.up), _axis(self.forward)
        right = np.cross(forward, up) * (1.0 if self.handedness == "right" else -1.0)
        m = np.array([right, up, -forward])
        return np.argmax(np.abs(m), axis=1), m.sum(axis=1)


def _axis(name: str) -> Floats:
    """The unit vector (3,) of `x`, `-x`, `y` ..."""
    letter = name.removeprefix("-")
    if letter not in ("x", "y", "z"):
        raise ValueError(f"an axis is x, y, z, -x, -y or -z, not {name!r}")
    return np.eye(3)["xyz".index(letter)] * (-1.0 if name.startswith("-") else 1.0)


# WebXR, OpenVR, ARKit and HoloLens write poses as OpenXR does.
OPENXR = Axes(up="y", forward="-z")
UNITY = Axes(up="y", forward="z", handedness="left")
UNREAL = Axes(up="z", forward="x", handedness="left", unit_m=0.01)
ROS = Axes(up="z", forward="x")
# Motion capture with z up, otherwise as with y up.
Z_UP = Axes(up="z", forward="y")
CONVENTIONS = {"openxr": OPENXR, "unity": UNITY, "unreal": UNREAL, "ros": ROS}
"""By the names that users write."""


def unity_to_openxr(pose: Transform) -> Transform:
    """Maps to p = (x, y, -z), q = (-x, -y, z, w)."""
    return UNITY.to_openxr(pose)
