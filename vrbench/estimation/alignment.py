"""Alignment: the rigid transform or similarity that lays one set of points onto another."""

from __future__ import annotations

import numpy as np

from vrbench.errors import EstimationError
from vrbench.estimation.checks import require_finite, require_finite_rows
from vrbench.geometry import Floats, Transform, matrix_to_quat, quat_to_matrix


def align(reference_p: Floats, estimate_p: Floats) -> Transform:
    """The transform T that minimises the sum of |reference - T estimate|^2, points (n, 3) [m].

    Umeyama (1991) without scale: what evo does for `-a`.

    Raises:
        EstimationError: as `umeyama_scale`.
    """
    _require_points(reference_p, estimate_p)
    means = column_means(reference_p), column_means(estimate_p)
    rotation, _ = _nearest_rotation(_cross_covariance(reference_p, estimate_p, *means))
    return Transform(means[0] - rotation @ means[1], matrix_to_quat(rotation))


def umeyama_scale(reference_p: Floats, estimate_p: Floats) -> float:
    """The scale of the best similarity from estimate to reference, points (n, 3): ref / est.

    Raises:
        EstimationError: fewer than 3 points, shapes that differ, values not finite, or points
            that lie in one place or on one line.
    """
    _require_points(reference_p, estimate_p)
    means = column_means(reference_p), column_means(estimate_p)
    _, trace = _nearest_rotation(_cross_covariance(reference_p, estimate_p, *means))
    centred = estimate_p - means[1]
    return trace / (float(np.einsum("ij,ij->", centred, centred)) / len(estimate_p))


def align_poses(reference: Transform, estimate: Transform, *, lever_m: float = 0.0) -> Transform:
    """The transform T that makes T @ estimate (n,) closest to reference (n,).

    With `lever_m` = 0 it is `align` of the positions. Otherwise the mean of
    |dp|^2 + lever_m^2 |dR - 1|_F^2 / 2 is least: a rotation error of 1 rad weighs like a position
    error of `lever_m` metres.

    Raises:
        EstimationError: fewer than 3 poses (positions only), values not finite, or poses that
            leave the rotation open.
    """
    require_finite(reference, "reference")
    require_finite(estimate, "estimate")
    if lever_m == 0.0:
        return align(reference.p, estimate.p)
    means = column_means(reference.p), column_means(estimate.p)
    cross = _cross_covariance(reference.p, estimate.p, *means)
    # the rotations enter like three points each, at their columns
    turned = np.einsum("nij,nkj->ik", quat_to_matrix(reference.q), quat_to_matrix(estimate.q))
    cross = cross + 0.5 * lever_m**2 * turned / len(reference)
    rotation, _ = _nearest_rotation(cross)
    return Transform(means[0] - rotation @ means[1], matrix_to_quat(rotation))


def column_means(values: Floats) -> Floats:
    """Means (k,) of rows (n, k): to rounding those of np.mean, in a tenth of its time."""
    return np.ones(len(values)) @ values / len(values)


def _require_points(reference_p: Floats, estimate_p: Floats) -> None:
    if reference_p.shape != estimate_p.shape or reference_p.shape[1:] != (3,):
        raise EstimationError(
            f"points of shape {reference_p.shape} against {estimate_p.shape}", fix="(n, 3) both"
        )
    if len(reference_p) < 3:
        raise EstimationError(
            f"only {len(reference_p)} points to align", fix="at least 3 are needed"
        )
    require_finite_rows(reference_p, "reference", "position")
    require_finite_rows(estimate_p, "estimate", "position")


def _cross_covariance(
    reference_p: Floats, estimate_p: Floats, reference_mean: Floats, estimate_mean: Floats
) -> Floats:
    cross: Floats = (reference_p - reference_mean).T @ (estimate_p - estimate_mean)
    return cross / len(reference_p)


def _nearest_rotation(cross: Floats) -> tuple[Floats, float]:
    """The rotation R (3, 3) that maximises trace(R^T cross), and that trace."""
    u, d, vt = np.linalg.svd(cross)
    if d[1] <= 1e-9 * d[0] or d[0] == 0.0:
        raise EstimationError(
            "the points lie in one place or on one line: the rotation is open",
            fix="use a motion that leaves the line",
        )
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation: Floats = (u * sign) @ vt
    return rotation, float(d @ sign)
