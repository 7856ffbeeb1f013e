"""APE and RPE of one trajectory against another, with evo's association, alignment and deltas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vrbench.errors import DataError, EstimationError
from vrbench.geometry import Floats, Transform
from vrbench.metrics.association import associate
from vrbench.metrics.evo_rounding import alignment, angles_from, matrices, steps, turns
from vrbench.metrics.pairs import TOLERANCE, Pairs, end_to_end, pairs_by_frames, pairs_by_path
from vrbench.metrics.pose_errors import ape_rotation, rpe
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
    if not question.rotation and question.delta is None:
        error = _distances(reference.pose.p[i], estimate.pose.p[j], question.aligned)
        return Answer(len(i), error)
    truth = _normalised(reference.pose[i], "reference")
    as_written = estimate.pose[j]
    found = _normalised(as_written, "estimate")
    frame = alignment(truth.p, found.p) if question.aligned else None
    if question.delta is None:
        aligned = found if frame is None else Transform.from_matrix(frame) @ found
        error = ape_rotation(truth, aligned)
    else:
        # what is between two poses doesn't depend on the frame they are told in
        apart = pairs(as_written, frame, question.delta)
        error = rpe(truth, found, apart)[1 if question.rotation else 0]
    return Answer(len(i), np.degrees(error) if question.rotation else error)


def _distances(reference_p: Floats, estimate_p: Floats, aligned: bool) -> Floats:
    """Distances (n,) [m] of positions (n, 3); of no other part of the poses."""
    if aligned:
        frame = alignment(reference_p, estimate_p)
        turned = sum(estimate_p[:, i, None] * frame[:3, i] for i in range(3))
        estimate_p = turned + frame[:3, 3]
    difference = estimate_p - reference_p
    return np.sqrt(np.einsum("ij,ij->i", difference, difference))


def pairs(pose: Transform, frame: Floats | None, delta: Delta) -> Pairs:
    """Indices (k,) of the first and of the second poses that are a delta apart.

    Args:
        pose: poses (n,), their quaternions as they stand: another division would be another
            rounding, on which ties depend.
        frame: the transform (4, 4) that aligns them, if they are aligned.
        delta: how far apart.

    Raises:
        EstimationError: there are none.
    """
    if delta.unit == "frames":
        found = pairs_by_frames(len(pose), int(delta.value), all_pairs=delta.all_pairs)
    else:
        m = matrices(pose)
        found = _measured(m if frame is None else np.matmul(frame, m), delta)
    if len(found[0]) == 0:
        raise EstimationError(
            f"no two of {len(pose)} poses are {delta.value:g} {delta.unit} apart",
            fix="a smaller DELTA",
        )
    return found


def _measured(m: Floats, delta: Delta) -> Pairs:
    """Pairs so many metres or so much of a turn apart, of matrices (n, 4, 4)."""
    if delta.unit == "m":
        if not delta.all_pairs:
            return end_to_end(steps(m), delta.value)
        tolerance = delta.value * TOLERANCE
        return pairs_by_path(m[:, :3, 3], delta.value, tolerance, all_pairs=True)
    rad, tolerance = delta.value, delta.value * TOLERANCE
    if delta.unit == "deg":
        rad, tolerance = float(np.deg2rad(rad)), float(np.deg2rad(tolerance))
    return _all_turned(m, rad, tolerance) if delta.all_pairs else end_to_end(turns(m), rad)


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
