"""Truth and estimate brought into one frame, point by point."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vrbench.errors import EstimationError
from vrbench.estimation.alignment import align, align_poses
from vrbench.geometry import (
    Floats,
    Transform,
    quat_conjugate,
    quat_multiply,
    quat_to_rotvec,
)
from vrbench.metrics.scored import ScoredTake

NO_X = "the mount has no calibration: X is unknown"
WORLD_UP = np.array([0.0, 1.0, 0.0])
MM = 1e3
# The length at which an error of rotation weighs as much as one of position in a fit of both. The
# published recordings err by about 1 mm and 0.28 deg; frames fitted there on 10 s, with levers from
# 0.1 to 0.6 m, left errors that differ by less than 7 %, and were best at 0.1.
LEVER_M = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """One point of a take, truth and estimate in the reference's frame.

    Attributes:
        point: `eye` or `tcp`.
        truth: `T_base_point` (n,).
        estimate: `T_base_point` as the headset has it (n,).
    """

    point: str
    truth: Transform
    estimate: Transform

    def translation(self) -> Floats:
        """Error vectors (n, 3) [m] in base: estimate minus truth."""
        return self.estimate.p - self.truth.p

    def rotation(self) -> Floats:
        """Error rotation vectors (n, 3) [rad] in base: from the truth to the estimate."""
        return quat_to_rotvec(quat_multiply(self.estimate.q, quat_conjugate(self.truth.q)))


def aligned(take: ScoredTake) -> Iterator[Compared]:
    """Eye and tcp, each aligned by SE(3) on its own positions over the whole window.

    Raises:
        EstimationError: no X, or positions that do not determine an alignment.
    """
    for point, truth, estimate in _points(take):
        yield Compared(point, truth, align(truth.p, estimate.p) @ estimate)


def aligned_eye(take: ScoredTake) -> Compared:
    """The eye alone, aligned by SE(3) on its positions; raises as `aligned` does."""
    return next(aligned(take))


def under(take: ScoredTake, y: Transform) -> Iterator[Compared]:
    """Eye and tcp under a given `T_base_world`; raises EstimationError without X."""
    for point, truth, estimate in _points(take):
        yield Compared(point, truth, y @ estimate)


def fit_poses(truth: Transform, estimate: Transform) -> Transform:
    """The frame (`T_base_world`) that fits poses (n,) best, in positions and rotations at once.

    Raises:
        EstimationError: the poses do not determine it.
    """
    return align_poses(truth, estimate, lever_m=LEVER_M)


def _points(take: ScoredTake) -> Iterator[tuple[str, Transform, Transform]]:
    if take.x is None:
        raise EstimationError(NO_X)
    return take.points()


def at_samples(between: Floats) -> Floats:
    """What is known between samples (n - 1,), at the samples (n,): the mean of both sides."""
    padded = np.concatenate((between[:1], between, between[-1:]))
    return (padded[:-1] + padded[1:]) / 2
