import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vrbench.errors import EstimationError
from vrbench.estimation.excitation import check_excitation
from vrbench.estimation.trim import active_window
from vrbench.geometry import quat_multiply, quat_normalize, rotvec_to_quat


def turning(spread_deg: tuple[float, float, float], noise_deg: float = 0.05) -> np.ndarray:
    """Rotations (n, 4) that sweep these ranges about x, y and z."""
    rng = np.random.default_rng(3)
    r = rng.uniform(-0.5, 0.5, (2000, 3)) * np.radians(spread_deg)
    return rotvec_to_quat(r + rng.normal(0.0, np.radians(noise_deg), r.shape))


def test_spreads_come_largest_first_with_their_axes():
    found = check_excitation(turning((10.0, 40.0, 20.0)))
    assert found.spread_deg == pytest.approx([38.0, 19.0, 9.5], rel=0.05)
    assert np.abs(found.axes) == pytest.approx(np.eye(3)[[1, 2, 0]], abs=0.05)
    assert found.text.startswith("38") and "about y, 19" in found.text


def test_pure_translation_is_refused():
    with pytest.raises(EstimationError, match="does not turn"):
        check_excitation(turning((0.0, 0.0, 0.0)))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_one_axis_is_refused_and_the_missing_ones_are_named(axis):
    spread = [0.0, 0.0, 0.0]
    spread[axis] = 60.0
    with pytest.raises(EstimationError) as refused:
        check_excitation(turning(tuple(spread)))
    missing = {"x", "y", "z"} - {"xyz"[axis]}
    named = str(refused.value).split("rotation about ")[1].split(" is missing")[0]
    assert set(named.split(" and ")) == missing


def test_three_or_more_finite_rotations_are_needed():
    with pytest.raises(EstimationError, match="only 2"):
        check_excitation(turning((9.0, 9.0, 9.0))[:2])
    q = turning((9.0, 9.0, 9.0))
    q[7, 0] = np.nan
    with pytest.raises(EstimationError, match="pose 8 is not finite"):
        check_excitation(q)


@settings(max_examples=25, deadline=None)
@given(r=st.tuples(*[st.floats(-3.0, 3.0)] * 3), flips=st.integers(0, 2**32 - 1))
def test_neither_the_base_frame_nor_the_sign_matters(r, flips):
    q = turning((12.0, 50.0, 25.0))
    signs = np.where(np.random.default_rng(flips).random(len(q)) < 0.5, -1.0, 1.0)
    moved = quat_normalize(quat_multiply(rotvec_to_quat(np.array(r)), q)) * signs[:, None]
    assert check_excitation(moved).spread_deg == pytest.approx(
        check_excitation(q).spread_deg, rel=1e-6
    )


def test_the_calibration_recording_is_accepted(recordings):
    for device in ("quest2", "quest_pro"):
        tcp = recordings[device, "calib"].tcp
        found = check_excitation(tcp.between(*active_window(tcp)).pose.q)
        assert found.spread_deg[0] > 90.0
        assert 5.0 < found.spread_deg[2] < found.spread_deg[1] < 20.0
        assert abs(found.axes[0, 2]) > 0.99
