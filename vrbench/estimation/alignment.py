"""Alignment of two sets of corresponding points by one rigid transform."""

from __future__ import annotations

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Transform, matrix_to_quat, quat_to_matrix


def align(reference_p: Floats, estimate_p: Floats) -> Transform:
    """The SE(3) transform that brings the estimate's points closest to the reference's.

    Umeyama, Least-squares estimation of transformation parameters between two point patterns,
    1991, without scale.

    Args:
        reference_p: points (n, 3) [m].
        estimate_p: the same points (n, 3) [m] in the estimate's frame.

    Returns:
        `T_reference_estimate`: maps the estimate's coordinates into the reference's.

    Raises:
        EstimationError: fewer than three points, or all of them on one line.
    """
    if len(reference_p) < 3:
        raise EstimationError(
            f"{len(reference_p)} poses do not determine an alignment", fix="at least three"
        )
    reference_mean, estimate_mean = reference_p.mean(axis=0), estimate_p.mean(axis=0)
    covariance = (reference_p - reference_mean).T @ (estimate_p - estimate_mean)
    u, d, vt = np.linalg.svd(covariance / len(reference_p))
    if d[1] <= np.finfo(np.float64).eps * max(d[0], 1e-30) or d[0] == 0.0:
        raise EstimationError(
            "the positions lie on one line and do not determine an alignment",
            fix="a motion in at least two directions",
        )
    sign = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    rotation = u @ np.diag([1.0, 1.0, sign]) @ vt
    return Transform(reference_mean - rotation @ estimate_mean, matrix_to_quat(rotation))


def umeyama_scale(reference_p: Floats, estimate_p: Floats) -> float:
    """The scale of the best similarity from estimate to reference, points (n, 3): ref / est.

    Raises:
        EstimationError: as `align`.
    """
    turned = align(reference_p, estimate_p).apply(estimate_p)
    turned, fixed = turned - turned.mean(axis=0), reference_p - reference_p.mean(axis=0)
    # At the best rotation, which scale doesn't change, the best scale is a plain regression.
    return float(np.sum(fixed * turned) / np.sum(turned * turned))


def align_poses(reference: Transform, estimate: Transform, *, lever_m: float) -> Transform:
    """The transform T that makes T @ estimate (n,) closest to reference (n,).

    The mean of |dp|^2 + lever_m^2 |dR - 1|_F^2 / 2 is least: a rotation error of 1 rad weighs like
    a position error of `lever_m` metres. An orthogonal Procrustes problem over both (Kabsch, 1976).

    Raises:
        EstimationError: there are no poses.
    """
    if len(reference) == 0:
        raise EstimationError("no poses to fit a frame on")
    p, p_estimate = reference.p.mean(axis=0), estimate.p.mean(axis=0)
    turned = np.einsum("nij,nkj->ik", quat_to_matrix(reference.q), quat_to_matrix(estimate.q))
    both = (reference.p - p).T @ (estimate.p - p_estimate) + 0.5 * lever_m**2 * turned
    u, _, vt = np.linalg.svd(both)
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)]) @ vt
    return Transform(p - rotation @ p_estimate, matrix_to_quat(rotation))
