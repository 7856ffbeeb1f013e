"""What decides ties in evo's choices: its own roundings, reproduced for whole columns.

A robot that turns by exactly one degree a frame makes of "10 deg apart" a tie, which the last bit
decides. So that the same pairs are chosen, poses become matrices, are aligned, and differ from
each other by the same operations in the same order as evo 1.3x has them; nothing else needs this.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Transform

EPS = float(np.finfo(np.float64).eps)


def matrices(pose: Transform) -> Floats:
    """Homogeneous matrices (n, 4, 4) of poses (n,), whose quaternions may have any length but 0."""
    q = np.ascontiguousarray(pose.q[:, [3, 0, 1, 2]])
    q = q * np.sqrt(2.0 / _squares(q))[:, None]
    x, y, z = (q[:, i, None] * q for i in (1, 2, 3))  # rows of the outer products
    m = np.zeros((len(q), 4, 4))
    m[:, 0, 0], m[:, 0, 1], m[:, 0, 2] = (
        1.0 - y[:, 2] - z[:, 3],
        x[:, 2] - z[:, 0],
        x[:, 3] + y[:, 0],
    )
    m[:, 1, 0], m[:, 1, 1], m[:, 1, 2] = (
        x[:, 2] + z[:, 0],
        1.0 - x[:, 1] - z[:, 3],
        y[:, 3] - x[:, 0],
    )
    m[:, 2, 0], m[:, 2, 1], m[:, 2, 2] = (
        x[:, 3] - y[:, 0],
        y[:, 3] + x[:, 0],
        1.0 - x[:, 1] - y[:, 2],
    )
    m[:, :3, 3], m[:, 3, 3] = pose.p, 1.0
    return m


def alignment(reference_p: Floats, estimate_p: Floats) -> Floats:
    """The rigid transform (4, 4) that lays points (n, 3) onto others: Umeyama (1991).

    Raises:
        EstimationError: the points lie in one place or on one line.
    """
    mean_e, mean_r = estimate_p.T.mean(axis=1), reference_p.T.mean(axis=1)
    products = (reference_p - mean_r)[:, :, None] * (estimate_p - mean_e)[:, None, :]
    u, d, vt = np.linalg.svd(
        1.0 / len(products) * products.reshape(-1, 9).sum(axis=0).reshape(3, 3)
    )
    if np.count_nonzero(d > EPS) < 2:
        raise EstimationError(
            f"{len(products)} pairs lie in one place or on one line: the alignment is open",
            fix="compare without --align, or more of the motion",
        )
    mirrored = np.linalg.det(u) * np.linalg.det(vt) < 0.0
    transform = np.eye(4)
    transform[:3, :3] = u.dot(np.diag([1.0, 1.0, -1.0 if mirrored else 1.0])).dot(vt)
    transform[:3, 3] = mean_r - transform[:3, :3].dot(mean_e)
    return transform


def steps(m: Floats) -> Floats:
    """Distances (n - 1,) [m] of neighbouring poses (n, 4, 4)."""
    between = np.diff(m[:, :3, 3], axis=0)
    return np.sqrt(_squares(between))


def turns(m: Floats) -> Floats:
    """Angles (n - 1,) [rad] between neighbouring poses (n, 4, 4)."""
    from scipy.spatial.transform import Rotation

    rotation = m[:, :3, :3]
    between = np.matmul(np.swapaxes(rotation[:-1], 1, 2), rotation[1:])
    if not len(between):
        return np.zeros(0)
    r = Rotation.from_matrix(between).as_rotvec()
    return np.sqrt(_squares(r))


def angles_from(m: Floats) -> Iterator[Floats]:
    """Of each pose of (n, 4, 4) but the last, the angles (k,) [rad] to all k behind it."""
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_matrix(m[:, :3, :3])
    for i in range(len(m) - 1):
        yield np.linalg.norm((rotation[i].inv() * rotation[i + 1 :]).as_rotvec(), axis=1)


def _squares(rows: Floats) -> Floats:
    """Squared lengths (n,) of rows (n, k), each added up as the dot product of one row is."""
    return np.matmul(rows[:, None, :], rows[:, :, None])[:, 0, 0]
