"""Hand-eye and robot-world calibration: X and Y of `T_base_tcp X = Y T_world_eye`, in O(n)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vrbench.errors import EstimationError
from vrbench.estimation.checks import require_finite
from vrbench.estimation.excitation import Excitation, check_excitation
from vrbench.estimation.robust import bisquare, soft_l1
from vrbench.geometry import (
    Bools,
    Floats,
    Transform,
    matrix_to_quat,
    mean_rotation,
    quat_angle,
    quat_to_matrix,
    relative_angle,
)

MINIMUM_POSES = 20
_SOFT_ROUNDS, _ROUNDS, _REWEIGHTED = 8, 20, 10_000
# Rotations left over by the best mounting, as a part of the motion's own: another motion's are
# about as large as the motion.
UNRELATED = 0.3
FRAME_TURN_DEG = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class HandEye:
    """The solution of `T_base_tcp X = Y T_world_eye`.

    Attributes:
        x: `T_tcp_eye`.
        y: `T_base_world`.
        translation_residual_m: root mean square over the inliers of the distance between
            `T_base_tcp X` and `Y T_world_eye` [m]: an error of the eye's position in `base`.
        rotation_residual_rad: the same of the angle between them [rad].
        inliers: which poses (n,) the solution rests on.
        excitation: how far the tcp turned.
    """

    x: Transform
    y: Transform
    translation_residual_m: float
    rotation_residual_rad: float
    inliers: Bools
    excitation: Excitation


def solve_handeye(T_base_tcp: Transform, T_world_eye: Transform) -> HandEye:
    """X and Y from poses (n,) at the same times; robust to some 20 % of outliers.

    Rotations by the singular vectors of the sum of Kronecker products (Shah, 2013), then
    translations by linear least squares; both reweighted until the outliers no longer count.

    Raises:
        EstimationError: fewer than 20 poses, values not finite, too little rotation
            (`check_excitation`), a mirrored stream, positions and orientations of different
            frames, orientations that are inverse or unrelated.
    """
    if len(T_base_tcp) != len(T_world_eye):
        raise ValueError(f"{len(T_base_tcp)} poses of the tcp for {len(T_world_eye)} of the eye")
    if len(T_base_tcp) < MINIMUM_POSES:
        raise EstimationError(
            f"only {len(T_base_tcp)} pairs of poses", fix=f"at least {MINIMUM_POSES} are needed"
        )
    require_finite(T_base_tcp, "T_base_tcp")
    require_finite(T_world_eye, "T_world_eye")
    excitation = check_excitation(T_base_tcp.q)
    A, E = quat_to_matrix(T_base_tcp.q), quat_to_matrix(T_world_eye.q)
    rx, ry, w_rotation = _solve_rotations(A, E)
    _refuse_unrelated(A, E, rx, ry, w_rotation)
    px, py, w_translation = _solve_translations(A, T_base_tcp.p, T_world_eye.p @ ry.T, w_rotation)
    _refuse_other_frames(A, T_base_tcp.p, T_world_eye.p, px, py, ry)
    x, y = Transform(px, matrix_to_quat(rx)), Transform(py, matrix_to_quat(ry))
    inliers = (w_rotation > 0.0) & (w_translation > 0.0)
    translation, rotation = residuals(T_base_tcp[inliers], T_world_eye[inliers], x, y)
    return HandEye(
        x,
        y,
        float(np.sqrt(np.mean(translation**2))),
        float(np.sqrt(np.mean(rotation**2))),
        inliers,
        excitation,
    )


def solve_world(T_base_tcp: Transform, T_world_eye: Transform, x: Transform) -> Transform:
    """Y = `T_base_world` where X = `T_tcp_eye` is known; robust as `solve_handeye`.

    Rotation and position are found apart, so a motion without any rotation will do.

    Raises:
        EstimationError: fewer than 3 poses, values not finite.
    """
    if len(T_base_tcp) < 3:
        raise EstimationError(f"only {len(T_base_tcp)} pairs of poses", fix="at least 3 are needed")
    require_finite(T_base_tcp, "T_base_tcp")
    require_finite(T_world_eye, "T_world_eye")
    target = T_base_tcp @ x
    few = slice(None, None, _stride(len(target)))
    wanted, found = quat_to_matrix(target.q[few]), quat_to_matrix(T_world_eye.q[few])
    weights = np.ones(len(wanted))
    for k in range(_ROUNDS):
        ry = _project(np.tensordot(wanted * weights[:, None, None], found, axes=((0, 2), (0, 2))))
        angle = _angles(wanted, ry @ found)
        weights = soft_l1(angle) if k < _SOFT_ROUNDS else bisquare(angle)
    offset = target.p - T_world_eye.p @ ry.T
    py = np.median(offset, axis=0)
    for _ in range(_ROUNDS):
        weights = bisquare(np.linalg.norm(offset - py, axis=1))
        py = weights @ offset / weights.sum()
    return Transform(py, matrix_to_quat(ry))


def refuse_other_handedness(T_base_tcp: Transform, T_world_eye: Transform) -> None:
    """Looks at poses (n,) that a known X doesn't bring together, for what is wrong with them.

    Raises:
        EstimationError: the eye's poses are mirrored or inverse, or its positions and orientations
            are in different frames.
    """
    A, E = quat_to_matrix(T_base_tcp.q), quat_to_matrix(T_world_eye.q)
    rx, ry, weights = _solve_rotations(A, E)
    error = float(np.median(_angles(A @ rx, ry @ E)))
    if error > np.radians(FRAME_TURN_DEG):
        _refuse_inverse(A, E, error)
    px, py, _ = _solve_translations(A, T_base_tcp.p, T_world_eye.p @ ry.T, weights)
    _refuse_other_frames(A, T_base_tcp.p, T_world_eye.p, px, py, ry)


def residuals(
    T_base_tcp: Transform, T_world_eye: Transform, x: Transform, y: Transform
) -> tuple[Floats, Floats]:
    """Distances (n,) [m] and angles (n,) [rad] between `T_base_tcp X` and `Y T_world_eye`."""
    left, right = T_base_tcp @ x, y @ T_world_eye
    return np.linalg.norm(left.p - right.p, axis=1), relative_angle(left.q, right.q)


def paper_residual(
    T_base_tcp: Transform, T_world_eye: Transform, x: Transform
) -> tuple[float, float]:
    """The hand-eye error of Banaszczyk et al. (2024): mean distance [m] and mean angle [rad].

    Of D_i = (X U_0^-1 U_i X^-1)^-1 (O_0^-1 O_i), U the eye's and O the tcp's poses: relative to
    the first pose, at the tcp, on the recording X came from.
    """
    eye = x @ (T_world_eye[0].inverse() @ T_world_eye) @ x.inverse()
    d = eye.inverse() @ (T_base_tcp[0].inverse() @ T_base_tcp)
    return float(np.mean(np.linalg.norm(d.p, axis=1))), float(np.mean(quat_angle(d.q)))


def _solve_rotations(A: Floats, E: Floats) -> tuple[Floats, Floats, Floats]:
    """R_x, R_y (3, 3) with A_i R_x = R_y E_i, and the weights (n,) of the pairs."""
    few_a, few_e = A[:: _stride(len(A))], E[:: _stride(len(A))]
    weights = np.ones(len(few_a))
    for k in range(_ROUNDS):
        rx, ry = _shah(few_a, few_e, weights)
        error = _angles(few_a @ rx, ry @ few_e)
        weights = soft_l1(error) if k < _SOFT_ROUNDS else bisquare(error)
    weights = bisquare(_angles(A @ rx, ry @ E))
    rx, ry = _shah(A, E, weights)
    return rx, ry, bisquare(_angles(A @ rx, ry @ E))


def _shah(A: Floats, E: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Shah's solution for rotations (n, 3, 3)."""
    n = len(A)
    # sum of w A_ij E_kl, ordered so that it maps vec(R_x), index (j, l), to vec(R_y), (i, k)
    products = (A.reshape(n, 9) * weights[:, None]).T @ E.reshape(n, 9)
    kron = products.reshape(3, 3, 3, 3).transpose(0, 2, 1, 3).reshape(9, 9)
    u, _, vt = np.linalg.svd(kron)
    return _project(vt[0].reshape(3, 3)), _project(u[:, 0].reshape(3, 3))


def _solve_translations(
    A: Floats, p_tcp: Floats, p_eye: Floats, from_rotation: Floats
) -> tuple[Floats, Floats, Floats]:
    """p_x, p_y with A_i p_x + p_tcp = p_eye + p_y (p_eye turned into base), and weights (n,)."""
    design = np.concatenate((A, np.broadcast_to(-np.eye(3), A.shape)), axis=2)
    right = p_eye - p_tcp
    few = slice(None, None, _stride(len(A)))
    weights = from_rotation[few]
    for k in range(_ROUNDS):
        solution = _weighted_lstsq(design[few], right[few], weights)
        error = np.linalg.norm(design[few] @ solution - right[few], axis=1)
        weights = soft_l1(error) if k < _SOFT_ROUNDS else bisquare(error)
        weights = weights * (from_rotation[few] > 0.0)
    weights = bisquare(np.linalg.norm(design @ solution - right, axis=1)) * (from_rotation > 0.0)
    solution = _weighted_lstsq(design, right, weights)
    return solution[:3], solution[3:], weights


def _stride(n: int) -> int:
    """Reweighting goes by every `_stride`-th pose, the last solve by all."""
    return max(n // _REWEIGHTED, 1)


def _weighted_lstsq(design: Floats, right: Floats, weights: Floats) -> Floats:
    """The solution (k,) of design (n, 3, k) x = right (n, 3) by normal equations."""
    k = design.shape[2]
    rows, values = design.reshape(-1, k), right.reshape(-1)
    weighted = rows * np.repeat(weights, 3)[:, None]
    # the pseudo-inverse: without rotation about one axis p_x and p_y share a direction
    solution: Floats = np.linalg.pinv(weighted.T @ rows, rcond=1e-12) @ (weighted.T @ values)
    return solution


def _refuse_unrelated(A: Floats, E: Floats, rx: Floats, ry: Floats, weights: Floats) -> None:
    """Raises EstimationError where no X and Y bring the rotations together."""
    error = float(np.median(_angles(A @ rx, ry @ E)))
    motion = quat_to_matrix(mean_rotation(matrix_to_quat(A)))
    if error < UNRELATED * float(np.median(_angles(A, np.broadcast_to(motion, A.shape)))):
        return
    _refuse_inverse(A, E, error)
    raise EstimationError(
        f"the orientations do not follow the reference's: {np.degrees(error):.1f} deg apart in "
        f"the median for the best mounting ({np.mean(weights > 0):.0%} of poses agree)",
        fix="check the clock, the order of the quaternion and that both streams are of one motion",
    )


def _refuse_inverse(A: Floats, E: Floats, error: float) -> None:
    """Raises EstimationError where the inverse rotations leave far less than error [rad]."""
    back = np.swapaxes(E, 1, 2)
    rx, ry, _ = _solve_rotations(A, back)
    if float(np.median(_angles(A @ rx, ry @ back))) < 0.2 * error:
        raise EstimationError(
            "the eye's orientations are inverse: T_eye_world instead of T_world_eye, or the "
            "quaternion's vector part has the wrong sign",
            fix="convert the headset's poses at their import",
        )


def _refuse_other_frames(
    A: Floats, p_tcp: Floats, p_eye: Floats, px: Floats, py: Floats, ry: Floats
) -> None:
    """Raises EstimationError where the eye's positions and rotations are not of one frame.

    A frame mirrored as a whole leaves rotations consistent, so the test is whether a free linear
    map of the positions fits far better than the rotation does, and whether it mirrors.
    """
    few = slice(None, None, _stride(len(A)))
    A, p_tcp, p_eye = A[few], p_tcp[few], p_eye[few]
    rigid = np.median(np.linalg.norm(A @ px + p_tcp - p_eye @ ry.T - py, axis=1))
    mapped = np.zeros((len(A), 3, 15))
    mapped[:, :, :3] = A
    mapped[:, :, 3:6] = -np.eye(3)
    for i in range(3):
        mapped[:, i, 6 + 3 * i : 9 + 3 * i] = p_eye.mean(axis=0) - p_eye
    weights = np.ones(len(A))
    for _ in range(_ROUNDS):
        free = _weighted_lstsq(mapped, -p_tcp, weights)
        error = np.linalg.norm(mapped @ free + p_tcp, axis=1)
        weights = soft_l1(error)
    linear = free[6:].reshape(3, 3)
    stretch = np.linalg.svd(linear, compute_uv=False)
    if stretch[2] < 0.5 or stretch[0] > 2.0 or np.median(error) > 0.2 * rigid:
        return
    if np.linalg.det(linear) < 0.0:
        raise EstimationError(
            "the eye's poses are mirrored: they fit only in a left-handed frame",
            fix="convert the headset's poses to a right-handed frame at their import",
        )
    turned = float(_angles(_project(linear)[None], ry[None])[0])
    if turned > np.radians(FRAME_TURN_DEG):
        raise EstimationError(
            "the eye's positions and orientations are in different frames, "
            f"{np.degrees(turned):.0f} deg apart: the orientations alone are mirrored, turned or "
            "inverse",
            fix="convert both the same way at their import",
        )


def _project(m: Floats) -> Floats:
    """The rotation (3, 3) nearest to a multiple, of either sign, of m."""
    m = m * np.sign(np.linalg.det(m))
    u, _, vt = np.linalg.svd(m)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt


def _angles(a: Floats, b: Floats) -> Floats:
    """Angles (n,) [rad] between rotation matrices (n, 3, 3), from the chord: exact when small."""
    chord = np.sqrt(np.einsum("nij,nij->n", a - b, a - b))
    return 2.0 * np.arcsin(np.minimum(chord / np.sqrt(8.0), 1.0))
