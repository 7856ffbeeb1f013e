"""The same pairs and errors as evo's, where ties, roundings and odd input decide."""

from __future__ import annotations

import contextlib
import io
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vrbench.errors import DataError, EstimationError
from vrbench.geometry import Transform, rotvec_to_quat
from vrbench.metrics.as_evo import Delta, Question, compare
from vrbench.metrics.association import nearest
from vrbench.trajectory import Stamped

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    pytest.importorskip("evo")
    from evo import EvoException
    from evo.core import metrics, sync
    from evo.core.trajectory import PoseTrajectory3D
    from evo.main_ape import ape as evo_ape
    from evo.main_rpe import rpe as evo_rpe

EPOCH = 1.7e9
UNITS = {
    "frames": metrics.Unit.frames,
    "m": metrics.Unit.meters,
    "deg": metrics.Unit.degrees,
    "rad": metrics.Unit.radians,
}


def as_evo(poses: Stamped) -> PoseTrajectory3D:
    q = np.ascontiguousarray(poses.pose.q[:, [3, 0, 1, 2]])
    return PoseTrajectory3D(poses.pose.p, q, poses.t)


def evo_says(reference: Stamped, estimate: Stamped, question: Question):
    relation = metrics.PoseRelation.translation_part
    if question.rotation:
        relation = metrics.PoseRelation.rotation_angle_deg
    a, b = sync.associate_trajectories(
        as_evo(reference), as_evo(estimate), max_diff=question.max_diff_s
    )
    with contextlib.redirect_stdout(io.StringIO()):
        if question.delta is None:
            return evo_ape(a, b, relation, align=question.aligned)
        return evo_rpe(
            a,
            b,
            relation,
            delta=question.delta.value,
            delta_unit=UNITS[question.delta.unit],
            all_pairs=question.delta.all_pairs,
            align=question.aligned,
        )


def assert_as_evo(reference: Stamped, estimate: Stamped, question: Question) -> None:
    theirs, ours = evo_says(reference, estimate, question), compare(reference, estimate, question)
    np.testing.assert_allclose(ours.error, theirs.np_arrays["error_array"], rtol=1e-9, atol=1e-12)
    assert ours.statistics.keys() == theirs.stats.keys()
    for name, value in ours.statistics.items():
        assert value == pytest.approx(theirs.stats[name], rel=1e-9, abs=1e-12), name
    assert question.title == theirs.info["title"]


def on_a_grid(n: int = 120) -> Stamped:
    """Once round a square in steps of 1 cm, turning by exactly one degree a frame."""
    k = np.arange(n)
    leg = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])[k // 25 % 4]
    turn = np.zeros((n, 3))
    turn[:, 1] = np.radians(1.0) * k
    pose = Transform(np.cumsum(leg * 0.01, axis=0), rotvec_to_quat(turn))
    return Stamped(EPOCH + k * 0.01, pose)


DELTAS = [None] + [
    Delta(value, unit, all_pairs)
    for value, unit in (
        (1.0, "frames"),
        (10.0, "frames"),
        (0.05, "m"),
        (0.1, "m"),
        (10.0, "deg"),
        (5.0, "deg"),
        (0.1, "rad"),
    )
    for all_pairs in (False, True)
]


@pytest.mark.parametrize("delta", DELTAS, ids=str)
@pytest.mark.parametrize("aligned", [False, True])
@pytest.mark.parametrize("rotation", [False, True])
@pytest.mark.parametrize("moved", ["same", "elsewhere", "noisy"])
def test_ties_fall_as_evo_s_do(delta, aligned, rotation, moved) -> None:
    reference = on_a_grid()
    pose = reference.pose
    if moved == "elsewhere":
        pose = Transform.of([0.1, 0.2, 0.3], [0.1, 0.2, 0.3, 0.9]) @ pose
    if moved == "noisy":
        rng = np.random.default_rng(1)
        pose = Transform(pose.p + rng.normal(0, 1e-3, pose.p.shape), pose.q)
    question = Question(rotation, aligned, delta)
    assert_as_evo(reference, Stamped(reference.t, pose), question)


# At 1.7e9 s stamps are 0.24 us from one to the next: sums and differences with 10 ms are rounded.
ticks = st.lists(st.integers(0, 12), min_size=1, max_size=12)


@given(ticks, ticks, st.sampled_from([0.005, 0.01, 0.02]), st.booleans(), st.booleans())
def test_stamps_of_epoch_size_pair_as_evo_s(a, b, max_diff, in_order, shaken) -> None:
    a, b = EPOCH + np.array(a) * 0.005, EPOCH + np.array(b) * 0.005
    if shaken:
        a = np.nextafter(a, np.inf)
    b = np.sort(b) if in_order else b
    i, j = nearest(a, b, max_diff)
    theirs = sync.matching_time_indices(a, b, max_diff)
    assert (i.tolist(), j.tolist()) == tuple([int(k) for k in part] for part in theirs)


@pytest.mark.parametrize("spoil", ["shorter", "longer", "equal", "unsorted", "twice", "long q"])
@pytest.mark.parametrize("question", [Question(), Question(aligned=True), Question(rotation=True)])
def test_odd_input_gives_evo_s_numbers(spoil: str, question: Question) -> None:
    reference = on_a_grid()
    rng = np.random.default_rng(2)
    n = len(reference)
    keep = {
        "shorter": np.arange(0, n, 2),
        "longer": np.sort(np.r_[np.arange(n), np.arange(n)]),
        "unsorted": rng.permutation(n),
        "twice": np.sort(rng.integers(0, n, n)),
    }.get(spoil, np.arange(n))
    t = reference.t[keep] + rng.choice([0.0, 0.005, 0.0049], len(keep))
    p = reference.pose.p[keep] + rng.normal(0, 1e-3, (len(keep), 3))
    q = reference.pose.q[keep] * (3.0 if spoil == "long q" else 1.0)
    estimate = Stamped(t, Transform(p, q))
    assert_as_evo(reference, estimate, question)
    assert_as_evo(estimate, reference, question)


@pytest.mark.parametrize(
    ("keep", "later_s", "question", "told"),
    [
        (50, 100.0, Question(), "lie within 0.01 s"),
        (2, 0.0, Question(aligned=True), "one place or on one line"),
        (20, 0.0, Question(aligned=True), "one place or on one line"),
        (1, 0.0, Question(delta=Delta(1, "frames")), "1 frames apart"),
        (50, 0.0, Question(delta=Delta(70, "frames")), "70 frames apart"),
        (50, 0.0, Question(delta=Delta(9.0, "m")), "9 m apart"),
        (50, 0.0, Question(delta=Delta(90.0, "deg", all_pairs=True)), "90 deg apart"),
    ],
)
def test_what_evo_refuses_is_refused_and_told(keep, later_s, question, told) -> None:
    whole = on_a_grid()
    part = Stamped(whole.t[:keep] + later_s, whole.pose[:keep])
    with pytest.raises(EvoException):
        evo_says(whole, part, question)
    with pytest.raises(EstimationError, match=told):
        compare(whole, part, question)


@pytest.mark.parametrize("n", [1, 2])
def test_few_poses_do_without_alignment(n: int) -> None:
    whole = on_a_grid()
    assert_as_evo(whole, Stamped(whole.t[:n], whole.pose[:n]), Question())


def test_no_rotation_at_all_is_told_where_rotations_matter() -> None:
    whole = on_a_grid()
    q = whole.pose.q.copy()
    q[7] = 0.0
    blank = Stamped(whole.t, Transform(whole.pose.p + 0.01, q))
    assert_as_evo(whole, blank, Question(aligned=True))
    for question in (Question(rotation=True), Question(delta=Delta(1, "frames"))):
        with pytest.raises(DataError, match="estimate: the quaternion of pose 8 is 0 0 0 0"):
            compare(whole, blank, question)
