"""APE and RPE of one trajectory against another, with evo's association, alignment and deltas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vrbench.errors import DataError
from vrbench.estimation.alignment import align
from vrbench.geometry import Floats, Transform
from vrbench.metrics.association import associate
from vrbench.metrics.pairs import find_pairs
from vrbench.metrics.pose_errors import ape_rotation, ape_translation, rpe
from vrbench.metrics.summary import statistics
from vrbench.trajectory import Stamped

STATISTICS = ("max", "mean", "median", "min", "rmse", "sse", "std")
# evo takes a shorter quaternion for no rotation at all, without a word: the square of its length.
NO_ROTATION = 4 * np.finfo(np.float64).eps


@dataclass(frozen=True, slots=True)
class Delta:
    """The distance of the two poses that RPE compares.

    Attributes:
        value: how far they are apart,
        unit: in `frames`, `m`, `deg` or `rad`.
        all_pairs: a pair from each pose, instead of end to end.
    """

    value: float
    unit: str
    all_pairs: bool = False

    def __str__(self) -> str:
        value = int(self.value) if self.unit == "frames" else float(self.value)
        which = "all" if self.all_pairs else "consecutive"
        return f"delta = {value} ({self.unit}) using {which} pairs"


@dataclass(frozen=True, slots=True)
class Question:
    """What is to be compared, and how.

    Attributes:
        rotation: angles [deg], instead of distances [m].
        aligned: the estimate is aligned by SE(3) on its positions first.
        delta: relative errors over it; absolute ones without.
        max_diff_s: how far the stamps of a pair may be apart [s].
    """

    rotation: bool = False
    aligned: bool = False
    delta: Delta | None = None
    max_diff_s: float = 0.01

    @property
    def title(self) -> str:
        """As evo writes it above its statistics."""
        part = "rotation angle in degrees (deg)" if self.rotation else "translation part (m)"
        lines = [f"{'APE' if self.delta is None else 'RPE'} w.r.t. {part}"]
        if self.delta is not None:
            lines.append(f"for {self.delta}")
        lines.append("(with SE(3) Umeyama alignment)" if self.aligned else "(not aligned)")
        return "\n".join(lines)


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """The errors.

    Attributes:
        associated: how many poses of both were paired by their stamps.
        error: errors (k,) [m or deg], of the poses, or of the pairs of poses a delta apart.
    """

    associated: int
    error: Floats

    @property
    def statistics(self) -> dict[str, float]:
        """evo's, by name."""
        found = statistics(self.error)
        return {name: found[name] for name in STATISTICS}


def compare(reference: Stamped, estimate: Stamped, question: Question) -> Answer:
    """The errors of an estimate against a reference, as evo has them.

    Raises:
        EstimationError: no stamps near enough, positions that don't determine an alignment, no
            poses a delta apart.
        DataError: a quaternion of length nought, where rotations matter.
    """
    i, j = associate(reference.t, estimate.t, question.max_diff_s)
    truth, found = reference.pose[i], estimate.pose[j]
    if question.rotation or question.delta is not None:
        truth, found = _normalised(truth, "reference"), _normalised(found, "estimate")
    if question.aligned:
        found = align(truth.p, found.p) @ found
    if question.delta is None:
        ape = ape_rotation if question.rotation else ape_translation
        error = ape(truth, found)
    else:
        delta = question.delta
        pairs = find_pairs(found, delta.value, delta.unit, all_pairs=delta.all_pairs)
        error = rpe(truth, found, pairs)[1 if question.rotation else 0]
    return Answer(len(i), np.degrees(error) if question.rotation else error)


def _normalised(pose: Transform, name: str) -> Transform:
    square = np.einsum("ij,ij->i", pose.q, pose.q)
    bad = np.flatnonzero(square < NO_ROTATION)
    if len(bad):
        raise DataError(
            f"the quaternion of pose {bad[0] + 1} is 0 0 0 0 ({len(bad)} such poses)",
            field=name,
            fix="only distances without a delta can be had without rotations",
        )
    return Transform.of(pose.p, pose.q)
