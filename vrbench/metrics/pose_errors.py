"""The errors behind APE and RPE, as columns: how far apart poses and motions are."""

from __future__ import annotations

import numpy as np

from vrbench.geometry import (
    Floats,
    Transform,
    quat_angle,
    quat_conjugate,
    quat_multiply,
    quat_rotate,
    relative_angle,
)
from vrbench.metrics.pairs import Pairs


def ape_translation(reference: Transform, estimate: Transform) -> Floats:
    """Distances (n,) [m] of corresponding poses: evo's `translation_part`."""
    return np.linalg.norm(estimate.p - reference.p, axis=1)


def ape_rotation(reference: Transform, estimate: Transform) -> Floats:
    """Angles (n,) [rad] between corresponding poses: evo's `rotation_angle_rad`."""
    return relative_angle(reference.q, estimate.q)


def rpe(reference: Transform, estimate: Transform, pairs: Pairs) -> tuple[Floats, Floats]:
    """By how much the motion within each pair differs: the relative pose error.

    Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, 2012:
    `E = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j)` with reference Q and estimate P.

    Args:
        reference: poses (n,).
        estimate: corresponding poses (n,).
        pairs: indices (k,) of the first and of the second poses.

    Returns:
        Translations (k,) [m] and angles (k,) [rad] of E.
    """
    translation, turn = rpe_poses(reference, estimate, pairs)
    # The translation of E is that difference turned, which leaves its length.
    return np.linalg.norm(translation, axis=1), quat_angle(turn)


def rpe_poses(reference: Transform, estimate: Transform, pairs: Pairs) -> tuple[Floats, Floats]:
    """The difference of the motions of `rpe`: translations (k, 3) [m] in the frame of the pair's
    first pose, estimate minus reference, and quaternions (k, 4) of E.
    """
    (p_reference, q_reference), (p_estimate, q_estimate) = (
        _within(pose, pairs) for pose in (reference, estimate)
    )
    return p_estimate - p_reference, quat_multiply(quat_conjugate(q_reference), q_estimate)


def _within(pose: Transform, pairs: Pairs) -> tuple[Floats, Floats]:
    i, j = pairs
    back = quat_conjugate(pose.q[i])
    return quat_rotate(back, pose.p[j] - pose.p[i]), quat_multiply(back, pose.q[j])
