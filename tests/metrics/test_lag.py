import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vrbench.errors import EstimationError
from vrbench.geometry import Transform, rotvec_to_quat
from vrbench.metrics.lag import differences, find_lag
from vrbench.trajectory import NS, Trajectory


def swing(start_s, duration_s, rate=125.0, offset_s=0.0):
    """A motion seen from start_s on, stamped offset_s late."""
    s = start_s + np.arange(0, duration_s, 1 / rate)
    p = np.stack([np.sin(s), np.sin(1.7 * s), np.cos(0.6 * s)], axis=1)
    t = np.rint((s + offset_s) * NS).astype(np.int64) + 10**18
    return Trajectory(t, Transform(p, rotvec_to_quat(0 * p)))


@given(st.floats(-4, 4), st.floats(-1e3, 1e3))
@settings(deadline=None, max_examples=25)
def test_the_lag_is_found_wherever_the_clock_stands(started_s, offset_s):
    a, b = swing(10, 30), swing(10 + started_s, 30, 120.0, offset_s)
    lag = find_lag(a, b)
    assert lag / NS == pytest.approx(offset_s, abs=1e-4)
    assert np.abs(differences(a, b, lag)).max() < 2e-4


def test_no_motion_has_no_lag():
    still = swing(0, 10).mapped(lambda pose: Transform(0 * pose.p, pose.q))
    with pytest.raises(EstimationError, match="nothing moves"):
        find_lag(still, still)


def test_single_samples_have_no_lag():
    with pytest.raises(EstimationError, match="two samples"):
        find_lag(swing(0, 10)[:1], swing(0, 10))
