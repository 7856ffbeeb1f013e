import numpy as np
import pytest

from vrbench.clocks import ClockMap
from vrbench.errors import EstimationError
from vrbench.estimation.interpolation import PoseSpline, paired
from vrbench.geometry import quat_conjugate, quat_multiply, quat_to_rotvec, relative_angle
from vrbench.trajectory import NS, Trajectory


def test_a_30_hz_reference_is_followed_to_a_hundredth_of_a_millimetre(truth):
    head = truth(1)
    reference = head.reference(20.0, 30.0)
    spline = PoseSpline(reference)
    s = np.linspace(0.5, 19.0, 4001)
    t = reference.t[0] + np.rint(s * NS).astype(np.int64)
    found, true = spline.at(t), head.tcp(s)
    assert np.abs(found.p - true.p).max() < 1e-5
    assert relative_angle(found.q, true.q).max() < np.radians(2e-3)


def test_rates_are_those_of_the_poses(truth):
    reference = truth(2).reference(20.0, 100.0)
    spline = PoseSpline(reference)
    s, h = np.linspace(1.0, 18.0, 500), 1e-4
    before, at, after = spline.motion(s - h), spline.motion(s), spline.motion(s + h)
    turn = quat_multiply(quat_conjugate(before.q), after.q)
    assert at.v == pytest.approx((after.p - before.p) / (2 * h), abs=1e-5)
    assert at.w == pytest.approx(quat_to_rotvec(turn) / (2 * h), abs=1e-5)


def test_it_passes_through_its_samples_whatever_their_signs(truth):
    reference = truth(3).reference(10.0)
    reference.pose.q[::3] *= -1.0
    found = PoseSpline(reference).at(reference.t)
    assert found.p == pytest.approx(reference.pose.p, abs=1e-12)
    assert relative_angle(found.q, reference.pose.q).max() < 1e-7


def test_nothing_is_interpolated_across_a_gap(truth):
    whole = truth(4).reference(20.0)
    keep = np.ones(len(whole), dtype=bool)
    keep[200:203] = False  # 4 periods
    keep[300] = False  # 2 periods: no gap
    spline = PoseSpline(whole[keep])
    t = np.arange(whole.t[0], whole.t[-1], 7_000_000)
    covered = spline.covers(t)
    in_gap = (t > whole.t[199]) & (t < whole.t[203])
    assert np.array_equal(covered, ~in_gap)
    assert np.array_equal(np.isfinite(spline.at(t).p).all(axis=1), covered)
    near = spline.covers(t, margin_ns=20_000_000)
    assert not near[(t > whole.t[199] - 19_000_000) & (t < whole.t[203] + 19_000_000)].any()


def test_stamps_too_close_invent_no_speed(truth):
    whole = truth(5).reference(20.0)
    t = np.insert(whole.t, 100, whole.t[99] + 50_000)
    pose = whole.pose[np.insert(np.arange(len(whole)), 100, 99)]
    pose.p[100] += 5e-4
    spline = PoseSpline(Trajectory(t, pose))
    speed = np.linalg.norm(spline.motion(np.linspace(0.1, 19.0, 5000)).v, axis=1)
    assert speed.max() < 1.0


def test_pairs_are_those_within_the_reference(truth):
    head = truth(6)
    reference, estimate = head.reference(10.0), head.estimate(12.0, offset_s=0.3)
    clock = ClockMap.affine(int(estimate.t[0]), 0.3)
    covered, tcp = paired(reference, estimate, clock)
    assert covered.sum() == len(tcp) == pytest.approx(720, abs=4)
    s = (clock.to_reference(estimate.t[covered]) - reference.t[0]) / NS
    assert tcp.p == pytest.approx(head.tcp(s).p, abs=1e-4)
    with pytest.raises(EstimationError, match="no pose of the estimate"):
        paired(reference, estimate, ClockMap.affine(int(estimate.t[0]), 100.0))


def test_a_reference_of_gaps_or_nan_is_refused(truth):
    reference = truth(7).reference(10.0)
    with pytest.raises(EstimationError, match="only 1 poses"):
        PoseSpline(reference[:1])
    reference.pose.q[4] = np.nan
    with pytest.raises(EstimationError, match="quaternion of pose 5"):
        PoseSpline(reference)
