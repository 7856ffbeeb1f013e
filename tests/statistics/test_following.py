import numpy as np
import pytest

from tests.statistics.test_uncertainty import scored
from vrbench.geometry import Transform, quat_multiply, rotvec_to_quat
from vrbench.statistics.following import STEP, following, shares


def test_a_headset_of_wrong_scale_errs_as_the_first_says():
    take = scored(0, 1.0, 0.0)
    larger, *_ = following(take)
    assert larger.estimate.pose.p - take.estimate.pose.p == pytest.approx(
        STEP * (take.truth.p - take.truth.p.mean(axis=0))
    )


def test_a_prediction_that_knows_no_acceleration_errs_as_the_others_say():
    """Along the acceleration, and the angular one: here of sines, whose own is known."""
    take = scored(0, 1.0, 0.0)
    s = take.estimate.t / 1e9
    _, pushed, turned = following(take)
    moved = (pushed.estimate.pose.p - take.estimate.pose.p) / STEP
    rate = np.gradient(np.gradient(take.truth.p, s, axis=0), s, axis=0)
    assert moved[5:-5] == pytest.approx(rate[5:-5], abs=1e-3)
    assert np.array_equal(turned.estimate.pose.p, take.estimate.pose.p)
    # small rotations: the angular acceleration is nearly that of the rotation vector
    back = quat_multiply(take.truth.q * [-1, -1, -1, 1], turned.estimate.pose.q)
    turn = 2.0 * back[:, :3] / STEP
    waves = [(1.0, np.sin), (0.7, np.cos), (0.4, np.sin)]
    expected = np.stack([-0.3 * w * w * wave(w * s) for w, wave in waves], axis=1)
    assert np.sqrt(np.mean((turn - expected)[5:-5] ** 2)) < 0.25 * np.sqrt(np.mean(expected**2))


def test_what_columns_explain_leaves_the_rest():
    rng = np.random.default_rng(0)
    one, other, noise = rng.normal(size=(3, 400, 3))
    error = 2.0 * one - other + noise
    found = shares(error, [one, other])
    assert found == pytest.approx([2.0, -1.0], abs=0.1)
    left = error - found[0] * one - found[1] * other
    assert [np.vdot(left, one), np.vdot(left, other)] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_a_take_at_rest_has_nothing_to_follow():
    take = scored(0, 1.0, 0.0)
    still = Transform(0.0 * take.truth.p, rotvec_to_quat(0.0 * take.truth.p))
    columns = [np.zeros((len(still), 3))] * 3
    assert not shares(np.ones((len(still), 3)), columns).any()
