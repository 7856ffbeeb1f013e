import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.estimation.opencv import METHODS, opencv_handeye
from vrbench.clocks import ClockMap
from vrbench.errors import EstimationError
from vrbench.estimation.handeye import paper_residual, residuals, solve_handeye, solve_world
from vrbench.estimation.interpolation import paired
from vrbench.estimation.trim import active_window
from vrbench.geometry import (
    Transform,
    quat_conjugate,
    quat_multiply,
    relative_angle,
    rotvec_to_quat,
)

TIMES = np.arange(0.0, 40.0, 0.05)


def poses(head, noise=(0.0, 0.0), seed=0) -> tuple[Transform, Transform]:
    """T_base_tcp and T_world_eye (n,), the latter with noise [m, rad] a component."""
    rng = np.random.default_rng(seed)
    tcp = head.tcp(TIMES)
    eye = head.y.inverse() @ tcp @ head.x
    p = eye.p + noise[0] * rng.normal(size=eye.p.shape)
    q = quat_multiply(eye.q, rotvec_to_quat(noise[1] * rng.normal(size=eye.p.shape)))
    return tcp, Transform(p, q)


def assert_close(found: Transform, true: Transform, m: float, rad: float) -> None:
    assert found.p == pytest.approx(true.p, abs=m)
    assert relative_angle(found.q, true.q) < rad


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_exact_poses_give_exact_transforms(truth, seed):
    head = truth(seed)
    found = solve_handeye(*poses(head))
    assert_close(found.x, head.x, 1e-9, 1e-9)
    assert_close(found.y, head.y, 1e-9, 1e-9)
    assert found.translation_residual_m < 1e-9
    assert found.inliers.all()


def test_residuals_are_the_noise(truth):
    head = truth(1)
    tcp, eye = poses(head, (1e-3, np.radians(0.1)))
    found = solve_handeye(tcp, eye)
    assert_close(found.x, head.x, 1e-3, 1e-3)
    assert found.translation_residual_m == pytest.approx(1e-3 * np.sqrt(3), rel=0.1)
    assert found.rotation_residual_rad == pytest.approx(np.radians(0.1) * np.sqrt(3), rel=0.1)
    translation, rotation = residuals(tcp, eye, found.x, found.y)
    assert np.sqrt(np.mean(translation**2)) == pytest.approx(found.translation_residual_m, rel=0.01)
    assert np.sqrt(np.mean(rotation**2)) == pytest.approx(found.rotation_residual_rad, rel=0.01)


@pytest.mark.parametrize("method", METHODS)
def test_opencv_s_five_methods_agree(truth, method):
    pytest.importorskip("cv2", reason="OpenCV is the oracle")
    tcp, eye = poses(truth(2), (1e-3, np.radians(0.1)))
    # Tsai's and Andreff's are known to suffer more from noise than the others.
    near = 6e-3 if method in ("tsai", "andreff") else 3e-3
    assert_close(solve_handeye(tcp, eye).x, opencv_handeye(tcp, eye, method), near, near)


def test_another_method_is_no_method(truth):
    tcp, eye = poses(truth(2), (0.0, 0.0))
    with pytest.raises(ValueError, match="one of tsai, park"):
        opencv_handeye(tcp, eye, "shah")


def test_opencv_s_robot_world_agrees(truth):
    cv2 = pytest.importorskip("cv2", reason="OpenCV is the oracle")
    if not hasattr(cv2, "calibrateHandEye"):
        pytest.skip("this OpenCV has no calibrateHandEye")
    head = truth(2)
    tcp, eye = poses(head, (1e-3, np.radians(0.1)))
    found = solve_handeye(tcp, eye)
    few = slice(None, None, 8)
    # robot-world: world to eye, base to tcp, in OpenCV's names
    c, d = tcp[few].inverse().matrix(), eye[few].inverse().matrix()
    out = cv2.calibrateRobotWorldHandEye(
        list(d[:, :3, :3]),
        list(d[:, :3, 3]),
        list(c[:, :3, :3]),
        list(c[:, :3, 3]),
        method=cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH,
    )
    y, x = (np.eye(4) for _ in range(2))
    y[:3, :3], y[:3, 3], x[:3, :3], x[:3, 3] = out[0], out[1].ravel(), out[2], out[3].ravel()
    assert_close(found.y.inverse(), Transform.from_matrix(y), 3e-3, 3e-3)
    assert_close(found.x.inverse(), Transform.from_matrix(x), 3e-3, 3e-3)


@pytest.mark.parametrize("kind", ["scattered", "frozen", "shifted"])
def test_a_fifth_of_outliers_does_not_matter(truth, kind):
    head = truth(3)
    tcp, eye = poses(head, (1e-3, np.radians(0.1)))
    n, rng = len(eye), np.random.default_rng(4)
    if kind == "scattered":
        bad = rng.choice(n, n // 5, replace=False)
        eye.p[bad] += rng.normal(0.0, 0.5, (len(bad), 3))
        turn = rotvec_to_quat(rng.normal(0.0, 0.7, (len(bad), 3)))
        eye.q[bad] = quat_multiply(turn, eye.q[bad])
    else:
        bad = np.arange(n // 3, n // 3 + n // 5)
        eye.p[bad] = eye.p[bad[0]] if kind == "frozen" else eye.p[bad] + [0.3, 0.0, 0.1]
        if kind == "frozen":
            eye.q[bad] = eye.q[bad[0]]
    found = solve_handeye(tcp, eye)
    assert_close(found.x, head.x, 2e-3, 2e-3)
    assert_close(found.y, head.y, 3e-3, 2e-3)
    assert found.inliers[bad].mean() < 0.1
    assert np.delete(found.inliers, bad).mean() > 0.97
    assert found.translation_residual_m < 3e-3
    y = solve_world(tcp, eye, head.x)
    assert_close(y, head.y, 2e-3, 1e-3)


def test_duplicates_change_nothing(truth):
    tcp, eye = poses(truth(5), (1e-3, 1e-3))
    twice = np.repeat(np.arange(len(tcp)), 2)
    once, doubled = solve_handeye(tcp, eye), solve_handeye(tcp[twice], eye[twice])
    assert_close(doubled.x, once.x, 1e-9, 1e-9)


@pytest.mark.parametrize("what", ["whole frame", "positions only", "orientations only"])
def test_a_mirrored_stream_is_named(truth, what):
    tcp, eye = poses(truth(6), (1e-3, 1e-3))
    p = eye.p if what == "orientations only" else eye.p * [1.0, 1.0, -1.0]
    q = eye.q if what == "positions only" else eye.q * [-1.0, -1.0, 1.0, 1.0]
    with pytest.raises(EstimationError, match="mirrored"):
        solve_handeye(tcp, Transform(p, q))


def test_a_wrong_scale_is_no_mirror(truth):
    head = truth(6)
    tcp, eye = poses(head, (1e-4, 1e-4))
    found = solve_handeye(tcp, Transform(eye.p * 1.2, eye.q))
    assert relative_angle(found.x.q, head.x.q) < 1e-3


def test_inverse_orientations_are_named(truth):
    tcp, eye = poses(truth(7), (1e-3, 1e-3))
    with pytest.raises(EstimationError, match="inverse"):
        solve_handeye(tcp, Transform(eye.p, quat_conjugate(eye.q)))


def test_unrelated_streams_and_shuffled_quaternions_are_refused(truth):
    tcp, eye = poses(truth(8))
    with pytest.raises(EstimationError, match="do not follow"):
        solve_handeye(tcp, eye[np.random.default_rng(0).permutation(len(eye))])


def test_too_few_nan_and_too_little_rotation_are_refused(truth):
    tcp, eye = poses(truth(9))
    with pytest.raises(EstimationError, match="only 10 pairs"):
        solve_handeye(tcp[:10], eye[:10])
    with pytest.raises(EstimationError, match="does not turn"):
        solve_handeye(*poses(truth(9, (1, 1, 1, 0, 0, 0))))
    with pytest.raises(EstimationError, match="one axis only"):
        solve_handeye(*poses(truth(9, (1, 1, 1, 0, 1, 0))))
    with pytest.raises(EstimationError, match="does not turn"):
        solve_handeye(tcp[np.zeros(100, dtype=int)], eye[np.zeros(100, dtype=int)])
    eye.p[17] = np.nan
    with pytest.raises(EstimationError, match="T_world_eye: position of pose 18"):
        solve_handeye(tcp, eye)


def test_the_world_is_found_without_rotation(truth):
    head = truth(10, (1, 1, 1, 0, 0, 0))
    tcp, eye = poses(head, (1e-3, 1e-3))
    assert_close(solve_world(tcp, eye, head.x), head.y, 2e-3, 1e-3)


def test_the_papers_residual_is_zero_for_the_truth_and_relative_to_the_first_pose(truth):
    head = truth(11)
    tcp, eye = poses(head)
    translation, rotation = paper_residual(tcp, eye, head.x)
    assert translation < 1e-12
    assert rotation < 1e-7
    moved = Transform.of([1.0, 2.0, 3.0], [0.5, 0.5, 0.5, 0.5]) @ eye
    assert paper_residual(tcp, moved, head.x)[0] < 1e-12


OFFSETS = {"quest2": -0.2640, "quest_pro": -0.0239}
PAPER_X = {
    "quest2": [
        [-0.999505, -0.0153348, 0.0274682, 0.00268286],
        [0.0277369, -0.0175974, 0.99946, 0.0867053],
        [-0.0148431, 0.999728, 0.018014, 0.276278],
    ],
    "quest_pro": [
        [-0.999487, 0.0211027, 0.0240903, -0.00143335],
        [0.0228977, -0.0550391, 0.998222, 0.099671],
        [0.0223911, 0.998261, 0.0545277, 0.248939],
    ],
}
# from the paper's reflection of Unity's frame (x) to ours (z): half a turn about y
HALF_TURN = Transform(np.zeros(3), np.array([0.0, 1.0, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("device", "offset_s", "printed_mm", "printed_deg"),
    [("quest2", -0.27, 9.3, 0.178), ("quest_pro", 0.0, 6.2, 0.209)],
)
def test_the_papers_residuals_come_out_of_its_mounting(
    recordings, device, offset_s, printed_mm, printed_deg
):
    take = recordings[device, "calib"]
    covered, tcp = paired(take.tcp, take.eye, ClockMap.affine(int(take.eye.t[0]), offset_s))
    x = Transform.from_matrix(PAPER_X[device]) @ HALF_TURN
    translation, rotation = paper_residual(tcp, take.eye.pose[covered], x)
    assert translation * 1e3 == pytest.approx(printed_mm, abs=0.05)
    assert np.degrees(rotation) == pytest.approx(printed_deg, abs=0.003)


@pytest.mark.parametrize("device", ["quest2", "quest_pro"])
def test_recordings_give_the_papers_mounting(recordings, device):
    take = recordings[device, "calib"]
    reference = take.tcp.between(*active_window(take.tcp))
    covered, tcp = paired(reference, take.eye, ClockMap.affine(int(take.eye.t[0]), OFFSETS[device]))
    found = solve_handeye(tcp, take.eye.pose[covered])
    paper = Transform.from_matrix(PAPER_X[device]) @ HALF_TURN
    assert_close(found.x, paper, 6e-3, np.radians(0.6))
    assert found.translation_residual_m < 3.5e-3
    assert found.rotation_residual_rad < np.radians(0.15)
    translation, rotation = paper_residual(tcp, take.eye.pose[covered], found.x)
    assert translation < 12e-3
    assert rotation < np.radians(0.3)
