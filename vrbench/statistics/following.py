"""Errors that follow the motion: of scale, and of predictions. They come back wherever it does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from vrbench.geometry import (
    Floats,
    Transform,
    continuous_signs,
    quat_conjugate,
    quat_multiply,
    quat_rotate,
    rotvec_to_quat,
)
from vrbench.metrics.compared import aligned
from vrbench.metrics.scored import ScoredTake

# Factor of each kind of error for its derivative: tenths of a millimetre, milliradians.
STEP = 1e-4


def following(take: ScoredTake) -> Iterator[ScoredTake]:
    """The take whose headset errs a little more in each way that follows the motion.

    By `STEP` times the way from the mean position, as a wrong scale does; times the acceleration;
    times the angular acceleration, as a prediction does that knows none [s^2].
    """
    if take.x is None:
        return
    pose, eye = take.estimate.pose, take.truth @ take.x
    seconds = take.estimate.seconds(int(take.estimate.t[0]))
    larger = pose.p + STEP * (pose.p - pose.p.mean(axis=0))
    yield _seen(take, Transform(larger, pose.q))
    acceleration = _rate(_rate(eye.p, seconds), seconds)
    in_eye = quat_rotate(quat_conjugate(eye.q), acceleration)
    yield _seen(take, Transform(pose.p + STEP * quat_rotate(pose.q, in_eye), pose.q))
    q = continuous_signs(eye.q)
    turning = 2.0 * quat_multiply(quat_conjugate(q), _rate(q, seconds))[:, :3]
    turn = rotvec_to_quat(STEP * _rate(turning, seconds))
    yield _seen(take, Transform(pose.p, quat_multiply(pose.q, turn)))


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """Aligned errors of translation at a point, taken apart.

    Attributes:
        noise: what of them doesn't follow the motion (n, 3) [m].
        turn: by how much what does turns the alignment (3,): a rotation vector in base [rad].
    """

    noise: Floats
    turn: Floats


def aligned_followed(take: ScoredTake) -> dict[str, Followed]:
    """By point; raises EstimationError where the take can't be aligned."""
    erring = [list(aligned(other)) for other in following(take)]
    found = {}
    for place, at in enumerate(aligned(take)):
        error, turn = at.translation(), at.rotation().mean(axis=0)
        others = [points[place] for points in erring]
        columns = np.stack([(other.translation() - error) / STEP for other in others], axis=2)
        turns = [(other.rotation().mean(axis=0) - turn) / STEP for other in others]
        share = shares(error, columns)
        found[at.point] = Followed(error - columns @ share, share @ np.array(turns))
    return found


def shares(error: Floats, columns: Floats) -> Floats:
    """How much of each column (n, 3, m) is in errors (n, 3), by least squares (m,)."""
    inner = np.einsum("ncm,ncl->ml", columns, columns)
    found: Floats = np.linalg.pinv(inner, hermitian=True) @ np.einsum("ncm,nc->m", columns, error)
    return found


def explained(error: Floats, columns: Floats) -> Floats:
    """What columns (n, 3, m) explain of errors (n, 3), by least squares (n, 3)."""
    found: Floats = columns @ shares(error, columns)
    return found


def _seen(take: ScoredTake, pose: Transform) -> ScoredTake:
    return replace(take, estimate=replace(take.estimate, pose=pose))


def _rate(values: Floats, seconds: Floats) -> Floats:
    rate: Floats = np.gradient(values, seconds, axis=0)
    return rate
