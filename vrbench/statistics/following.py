"""Errors that follow the motion: of scale, and of predictions. They come back wherever it does."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
from vrbench.metrics.scored import ScoredTake

# Factor of each kind of error for its derivative: tenths of a millimetre, milliradians.
STEP = 1e-4

# Of an error: its metric, and the point it is seen at.
Key = tuple[str, str]
# The error vectors (n, 3) of a take, by metric and point.
Vectors = Callable[[ScoredTake], Iterable[tuple[Key, Floats]]]


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
class Errors:
    """Errors of a take, and how they change with those of the headset that follow the motion.

    Attributes:
        here: error vectors (n, 3), by metric and point.
        like: their derivatives (n, 3) by each way of `following`.
    """

    here: Mapping[Key, Floats]
    like: Mapping[Key, Sequence[Floats]]

    def followed(self, key: Key) -> Floats:
        """What of them follows the motion (n, 3)."""
        error, columns = self.here[key], self.like[key]
        return _sum(shares(error, columns), columns)


def errors_of(take: ScoredTake, vectors: Vectors) -> Errors:
    """The errors of a take and their derivatives; raises as `vectors` does."""
    here = dict(vectors(take))
    like: dict[Key, list[Floats]] = {key: [] for key in here}
    for erring in following(take):
        for key, there in vectors(erring):
            like[key].append((there - here[key]) / STEP)
    return Errors(here, like)


def shares(error: Floats, columns: Sequence[Floats]) -> Floats:
    """How much of each of the columns (n, 3) is in errors (n, 3), by least squares (m,)."""
    inner = np.array([[np.vdot(one, other) for other in columns] for one in columns])
    found: Floats = np.linalg.pinv(inner, hermitian=True) @ [np.vdot(x, error) for x in columns]
    return found


def _sum(factors: Floats, columns: Sequence[Floats]) -> Floats:
    found = factors[0] * columns[0]
    for factor, column in zip(factors[1:], columns[1:], strict=True):
        found += factor * column
    return found


def _seen(take: ScoredTake, pose: Transform) -> ScoredTake:
    return replace(take, estimate=replace(take.estimate, pose=pose))


def _rate(values: Floats, seconds: Floats) -> Floats:
    rate: Floats = np.gradient(values, seconds, axis=0)
    return rate
