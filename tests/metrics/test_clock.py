import pytest

from vrbench.clocks import ClockMap
from vrbench.metrics import clock


def test_clock_gives_the_offset_in_the_middle_and_the_mean_skew(values, make_take):
    start = int(make_take().reference.t[0])
    found = values(clock.FAMILY, make_take(clock=ClockMap.affine(start, -0.26, 20e-6)))
    assert found["clock.skew", "", "all", "value"].value == pytest.approx(20, rel=1e-3)
    expected = -260 + 20e-6 * (10 - 0.26) * 1e3
    assert found["clock.offset", "", "all", "value"].value == pytest.approx(expected, abs=1e-3)
    assert found["clock.residual", "", "all", "rmse"].value is None
    constant = values(clock.FAMILY, make_take(clock=ClockMap.affine(start, 0.1)))
    assert "no calibration tells one" in constant["clock.skew", "", "all", "value"].reason


def test_the_residual_comes_from_the_fit(values, make_take):
    class Fit:
        residual_s = 0.0015

    found = values(clock.FAMILY, make_take(clock_fit=Fit()))
    assert found["clock.residual", "", "all", "rmse"].value == pytest.approx(1.5)
