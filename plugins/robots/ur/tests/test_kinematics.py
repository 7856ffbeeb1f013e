import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from vrbench_ur.arms import ARMS, UR5E, Dh, arm
from vrbench_ur.inverse import BRANCHES, branch_name, pose_error, refine, solve
from vrbench_ur.kinematics import flange, flange_once, jacobian, link_frames

from vrbench.errors import ConfigError, EstimationError
from vrbench.geometry import Transform

ANGLES = st.lists(st.floats(-3.1, 3.1), min_size=6, max_size=6).map(np.array)
EACH_ARM = pytest.mark.parametrize("robot", ARMS.values(), ids=list(ARMS))


def by_hand(q, dh):
    """The product of the four elementary transforms of each joint, one after another."""
    whole = np.eye(4)
    for i in range(6):
        c, s = np.cos(q[i] + dh.theta[i]), np.sin(q[i] + dh.theta[i])
        ca, sa = np.cos(dh.alpha[i]), np.sin(dh.alpha[i])
        rz = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        tz, tx, rx = np.eye(4), np.eye(4), np.eye(4)
        tz[2, 3], tx[0, 3] = dh.d[i], dh.a[i]
        rx[1:3, 1:3] = [[ca, -sa], [sa, ca]]
        whole = whole @ rz @ tz @ tx @ rx
    return whole


def test_stretched_out_the_ur5e_is_where_its_maker_says():
    np.testing.assert_allclose(
        flange(np.zeros(6), UR5E.dh).p, [-0.8172, -0.2329, 0.0628], atol=1e-12
    )


@EACH_ARM
@given(q=ANGLES)
@settings(max_examples=30, deadline=None)
def test_forward_kinematics_is_the_product_of_the_published_steps(robot, q):
    want = by_hand(q, robot.dh)
    np.testing.assert_allclose(link_frames(q, robot.dh)[6], want, atol=1e-12)
    r, p = flange_once(q, robot.dh)
    np.testing.assert_allclose(r, want[:3, :3], atol=1e-12)
    np.testing.assert_allclose(p, want[:3, 3], atol=1e-12)


@EACH_ARM
@given(q=ANGLES)
@settings(max_examples=30, deadline=None)
def test_every_posture_the_inverse_finds_reaches_the_pose(robot, q):
    pose = flange(q[None], robot.dh)
    found = solve(pose, robot.dh)[0]
    there = ~np.isnan(found[:, 0])
    for posture in found[there]:
        assert np.abs(pose_error(posture[None], pose, robot.dh)).max() < 1e-9


@EACH_ARM
@given(q=ANGLES)
@settings(max_examples=50, deadline=None)
def test_one_of_the_postures_is_the_one_that_made_the_pose(robot, q):
    wrist, elbow = abs(np.sin(q[4])), abs(np.sin(q[2]))
    centre = link_frames(q, robot.dh)[5, :2, 3]
    if min(wrist, elbow) < 1e-3 or np.hypot(*centre) < robot.dh.d[3] + 1e-3:
        return
    found = solve(flange(q[None], robot.dh), robot.dh)[0]
    apart = np.abs((found - q + np.pi) % (2 * np.pi) - np.pi).max(axis=1)
    assert np.nanmin(apart) < 1e-6


def test_a_numeric_solver_started_nearby_finds_the_same_postures():
    rng = np.random.default_rng(3)
    pose = flange(np.array([[0.3, -1.2, 1.4, -0.7, 1.1, 0.4]]), UR5E.dh)
    found = solve(pose, UR5E.dh)[0]
    assert (~np.isnan(found[:, 0])).sum() == BRANCHES
    want = pose.matrix()[0]

    def residual(q):
        return (by_hand(q, UR5E.dh)[:3] - want[:3]).ravel()

    for posture in found:
        start = posture + rng.normal(0.0, 0.02, 6)
        solved = least_squares(residual, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        np.testing.assert_allclose(solved.x, posture, atol=1e-6)


def test_the_eight_postures_differ_and_have_names():
    found = solve(flange(np.array([[0.3, -1.2, 1.4, -0.7, 1.1, 0.4]]), UR5E.dh), UR5E.dh)[0]
    apart = np.abs(found[:, None] - found[None]).max(axis=2) + np.eye(BRANCHES)
    assert apart.min() > 0.05
    assert len({branch_name(k) for k in range(BRANCHES)}) == BRANCHES


def test_out_of_reach_is_nan_and_no_warning():
    far = Transform(np.array([[2.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 0.0, 1.0]]))
    assert np.isnan(solve(far, UR5E.dh)).all()


@given(q=ANGLES)
@settings(max_examples=20, deadline=None)
def test_the_jacobian_is_the_derivative(q):
    step = 1e-6
    moved = q + step * np.eye(6)
    p0, p1 = flange(q, UR5E.dh), flange(moved, UR5E.dh)
    np.testing.assert_allclose((p1.p - p0.p).T / step, jacobian(q, UR5E.dh)[:3], atol=1e-5)


def test_newton_reaches_the_pose_with_a_calibrated_arm():
    rng = np.random.default_rng(5)
    small = (rng.normal(0, 5e-4, 6) for _ in range(4))
    dh = UR5E.dh
    own = Dh(dh.d + next(small), dh.a + next(small), dh.alpha + next(small), next(small))
    q = np.tile([0.3, -1.2, 1.4, -0.7, 1.1, 0.4], (20, 1)) + rng.normal(0, 0.1, (20, 6))
    pose = flange(q, dh)
    assert np.abs(pose_error(q, pose, own)).max() > 1e-4
    assert np.abs(pose_error(refine(q, pose, own), pose, own)).max() < 1e-10


def test_newton_says_so_where_it_cannot():
    far = Transform(np.array([[2.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 0.0, 1.0]]))
    with pytest.raises(EstimationError, match="singular"):
        refine(np.array([[0.3, -1.2, 1.4, -0.7, 1.1, 0.4]]), far, UR5E.dh)


def test_an_unknown_arm_is_refused_with_those_there_are():
    with pytest.raises(ConfigError, match="there are ur3e, ur5e, ur10e"):
        arm("ur7")
