"""APE and RPE of one trajectory against another, with evo's association, alignment and deltas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vrbench.errors import DataError, EstimationError
from vrbench.geometry import Floats, Transform
from vrbench.metrics.association import associate
from vrbench.metrics.evo_rounding import alignment, angles_from, matrices, steps, turns
from vrbench.metrics.pairs import TOLERANCE, Pairs, end_to_end, pairs_by_frames, pairs_by_path
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
        # the matrices are of the quaternions as they stand: another division is another rounding
        normalised = _normalised(truth, "reference"), _normalised(found, "estimate")
        m = matrices(found)
        truth, found = normalised
    else:
        found = Transform(found.p, np.tile([0.0, 0.0, 0.0, 1.0], (len(found), 1)))
        m = matrices(found)
    if question.aligned:
        frame = alignment(truth.p, found.p)
        m = np.matmul(frame, m)
        found = Transform(m[:, :3, 3], (Transform.from_matrix(frame) @ found).q)
    if question.delta is None:
        ape = ape_rotation if question.rotation else ape_translation
        error = ape(truth, found)
    else:
        error = rpe(truth, found, pairs(m, question.delta))[1 if question.rotation else 0]
    return Answer(len(i), np.degrees(error) if question.rotation else error)


def pairs(m: Floats, delta: Delta) -> Pairs:
    """Indices (k,) of the first and of the second poses, of (n, 4, 4), that are a delta apart.

    Raises:
        EstimationError: there are none.
    """
    if delta.unit == "frames":
        found = pairs_by_frames(len(m), int(delta.value), all_pairs=delta.all_pairs)
    elif delta.unit == "m":
        if delta.all_pairs:
            tolerance = delta.value * TOLERANCE
            found = pairs_by_path(m[:, :3, 3], delta.value, tolerance)
        else:
            found = end_to_end(steps(m), delta.value)
    else:
        rad, tolerance = delta.value, delta.value * TOLERANCE
        if delta.unit == "deg":
            rad, tolerance = float(np.deg2rad(rad)), float(np.deg2rad(tolerance))
        found = _all_turned(m, rad, tolerance) if delta.all_pairs else end_to_end(turns(m), rad)
    if len(found[0]) == 0:
        raise EstimationError(
            f"no two of {len(m)} poses are {delta.value:g} {delta.unit} apart",
            fix="a smaller DELTA",
        )
    return found


def _all_turned(m: Floats, rad: float, tolerance: float) -> Pairs:
    """Every pair turned by an angle against each other; time goes with the square of the poses."""
    matches = [
        np.flatnonzero((angle >= rad - tolerance) & (angle <= rad + tolerance)) + i + 1
        for i, angle in enumerate(angles_from(m))
    ]
    first = np.repeat(np.arange(len(matches)), [len(found) for found in matches])
    return first, np.concatenate([*matches, np.zeros(0, dtype=np.int64)])


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
