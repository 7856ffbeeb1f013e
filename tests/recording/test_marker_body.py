from pathlib import Path

import numpy as np
import pytest

from tests.recording.markers import markers_of
from vrbench.errors import DataError
from vrbench.geometry import Transform, relative_angle, rotvec_to_quat
from vrbench.recording.marker_body import fit_body

FILE = Path("take.c3d")
N = 200
RNG = np.random.default_rng(5)
SHAPE = (
    np.array([[81, 34, -41], [-74, 41, -32], [13, 78, 21], [-52, -29, -63], [64, -47, -58]]) / 1e3
)
POSE = Transform(
    np.cumsum(RNG.normal(0, 0.01, (N, 3)), axis=0),
    rotvec_to_quat(np.cumsum(RNG.normal(0, 0.03, (N, 3)), axis=0)),
)


def fit(markers, tolerance_m=0.002):
    return fit_body(markers, tolerance_m=tolerance_m, file=FILE)


def offset(body):
    """`T_true_body` (n,), which is constant where the body is right."""
    return POSE.inverse() @ body.pose


def test_the_pose_is_exact_up_to_the_bodys_own_frame():
    body = fit(markers_of(SHAPE, POSE))
    assert body.seen.all()
    assert body.residual_m.max() < 1e-12
    constant = offset(body)
    assert np.ptp(constant.p, axis=0).max() < 1e-12
    assert relative_angle(constant.q, constant.q[0]).max() < 1e-7
    np.testing.assert_allclose(body.shape.mean(axis=0), 0, atol=1e-12)


def test_two_takes_of_the_same_markers_have_the_same_frame():
    other = Transform.of([3.0, 1.0, -2.0], [0.5, 0.5, -0.5, 0.5])
    noisy = [
        m + np.random.default_rng(seed).normal(0, 1e-4, m.shape)
        for seed, m in enumerate((markers_of(SHAPE, POSE), markers_of(SHAPE, other @ POSE)))
    ]
    a, b = map(fit, noisy)
    np.testing.assert_allclose(a.shape, b.shape, atol=5e-5)
    assert np.linalg.norm((other @ a.pose).p - b.pose.p, axis=1).max() < 5e-4


def test_a_body_is_seen_by_three_of_its_markers_and_not_by_two():
    markers = markers_of(SHAPE, POSE)
    markers[10:20, :2] = np.nan
    markers[20:30, :3] = np.nan
    body = fit(markers)
    assert np.flatnonzero(~body.seen).tolist() == list(range(20, 30))
    whole = fit(markers_of(SHAPE, POSE))
    np.testing.assert_allclose(body.pose.p[body.seen], whole.pose.p[body.seen], atol=1e-9)
    assert np.isfinite(body.pose.p).all()


def test_markers_taken_for_each_other_make_a_frame_unseen():
    markers = markers_of(SHAPE, POSE)
    markers[50:55, [0, 1]] = markers[50:55, [1, 0]]
    assert np.flatnonzero(~fit(markers).seen).tolist() == list(range(50, 55))


@pytest.mark.parametrize(
    ("markers", "says"),
    [
        (markers_of(SHAPE[:2], POSE), "has 2 markers"),
        (markers_of(np.outer(np.arange(4), [0.1, 0.1, 0]), POSE), "lie on a line"),
        (np.where(np.arange(5)[:, None] == 2, np.nan, markers_of(SHAPE, POSE)), "never all seen"),
        (RNG.normal(0, 0.1, (N, 4, 3)), "don't keep their distances within 2 mm"),
    ],
)
def test_what_is_no_rigid_body_is_refused(markers, says):
    with pytest.raises(DataError, match=says):
        fit(markers)
