import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vrbench.errors import EstimationError
from vrbench.estimation.alignment import align, align_poses, umeyama_scale
from vrbench.geometry import (
    Transform,
    quat_multiply,
    quat_to_matrix,
    relative_angle,
    rotvec_to_quat,
)


def points(seed: int = 0, n: int = 200) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, 0.3, (n, 3))


@settings(max_examples=50, deadline=None)
@given(
    p=st.tuples(*[st.floats(-10.0, 10.0)] * 3),
    r=st.tuples(*[st.floats(-1.8, 1.8)] * 3),
    scale=st.floats(0.5, 2.0),
    seed=st.integers(0, 1000),
)
def test_a_similarity_is_recovered(p, r, scale, seed):
    truth = Transform(np.array(p), rotvec_to_quat(np.array(r)))
    estimate = points(seed)
    reference = truth.apply(scale * estimate)
    assert umeyama_scale(reference, estimate) == pytest.approx(scale, rel=1e-9)
    found = align(truth.apply(estimate), estimate)
    assert found.p == pytest.approx(truth.p, abs=1e-9)
    assert relative_angle(found.q, truth.q) < 1e-9


def test_it_is_evos():
    geometry = pytest.importorskip("evo.core.geometry", reason="evo is the oracle")
    reference, estimate = points(1), points(2) + 0.8 * points(1)
    rotation, translation, _ = geometry.umeyama_alignment(estimate.T, reference.T)
    found = align(reference, estimate)
    assert quat_to_matrix(found.q) == pytest.approx(rotation, abs=1e-12)
    assert found.p == pytest.approx(translation, abs=1e-12)
    *_, scale = geometry.umeyama_alignment(estimate.T, reference.T, with_scale=True)
    assert umeyama_scale(reference, estimate) == pytest.approx(scale, abs=1e-12)


def test_a_mirrored_cloud_is_still_aligned_by_a_rotation():
    estimate = points(3)
    found = align(estimate * [1.0, 1.0, -1.0], estimate)
    assert np.linalg.det(quat_to_matrix(found.q)) == pytest.approx(1.0)


def test_no_other_rotation_fits_better():
    rng = np.random.default_rng(4)
    reference, estimate = points(5), points(5) + 0.1 * points(6)
    found = align(reference, estimate)
    best = np.sum((reference - found.apply(estimate)) ** 2)
    for _ in range(50):
        other = Transform(
            found.p + rng.normal(0.0, 0.01, 3),
            quat_multiply(rotvec_to_quat(rng.normal(0.0, 0.01, 3)), found.q),
        )
        assert np.sum((reference - other.apply(estimate)) ** 2) > best


def test_poses_on_a_line_are_aligned_by_their_rotations():
    truth = Transform(np.array([1.0, 2.0, 3.0]), rotvec_to_quat(np.array([0.3, -1.0, 0.5])))
    p = np.linspace(0.0, 1.0, 50)[:, None] * np.array([1.0, 0.0, 0.0])
    q = rotvec_to_quat(points(8, 50))
    estimate = Transform(p, q)
    reference = truth @ estimate
    with pytest.raises(EstimationError, match="one line"):
        align_poses(reference, estimate)
    found = align_poses(reference, estimate, lever_m=0.1)
    assert found.p == pytest.approx(truth.p, abs=1e-9)
    assert relative_angle(found.q, truth.q) < 1e-9


def test_the_lever_weighs_rotation_against_position():
    """Positions ask for one rotation, orientations for another."""
    estimate = Transform(points(9), rotvec_to_quat(points(10)))
    turn = rotvec_to_quat(np.array([0.0, 0.0, 0.02]))
    reference = Transform(estimate.p, quat_multiply(turn, estimate.q))
    angles = [
        2.0 * align_poses(reference, estimate, lever_m=lever).q[2] for lever in (0.0, 0.1, 1.0, 100)
    ]
    assert angles == sorted(angles)
    assert angles[0] == pytest.approx(0.0, abs=1e-12)
    assert angles[-1] == pytest.approx(0.02, rel=1e-3)


@pytest.mark.parametrize(
    ("reference", "estimate", "what"),
    [
        (points()[:2], points()[:2], "only 2 points"),
        (points(), points()[:-1], "shape"),
        (points() * 0.0, points(), "one place"),
        (points() * [1.0, 0.0, 0.0], points() * [1.0, 0.0, 0.0], "one line"),
        (np.where(points() > 0.9, np.nan, points()), points(), "not finite"),
    ],
)
def test_what_cannot_be_aligned_is_refused(reference, estimate, what):
    with pytest.raises(EstimationError, match=what):
        align(reference, estimate)
