"""Errors that follow the motion: of scale, and of predictions. They come back wherever it does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

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


def explained(error: Floats, columns: Floats) -> Floats:
    """What columns (n, 3, m) explain of errors (n, 3), by least squares (n, 3)."""
    inner = np.einsum("ncm,ncl->ml", columns, columns)
    share = np.linalg.pinv(inner, hermitian=True) @ np.einsum("ncm,nc->m", columns, error)
    found: Floats = columns @ share
    return found


def _seen(take: ScoredTake, pose: Transform) -> ScoredTake:
    return replace(take, estimate=replace(take.estimate, pose=pose))


def _rate(values: Floats, seconds: Floats) -> Floats:
    rate: Floats = np.gradient(values, seconds, axis=0)
    return rate
