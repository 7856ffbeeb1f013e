"""Whether the headset moved on its mount while hands were at it, and which X holds when."""

import numpy as np

from vrbench.geometry import Transform
from vrbench.protocols.calibration import Calibration
from vrbench.protocols.fixing import fixing_at

MINUTE = 60 * 10**9
BRACKET_M = 0.001


def found(name: str, minute: int, *, off_mm: float = 0.0, sigma_mm: float = 0.1) -> Calibration:
    """X as a take of this minute found it, so far off to one side."""
    still = Transform(np.zeros((1, 3)), np.array([[0.0, 0.0, 0.0, 1.0]]))
    covariance = np.diag([1e-12] * 3 + [(sigma_mm * 1e-3) ** 2] * 3)
    x = Transform.of((0.1 + off_mm * 1e-3, 0.0, 0.3), (0.0, 0.0, 0.0, 1.0))
    return Calibration(
        *(name, x, x, 0.001, 0.001, minute * MINUTE, (minute + 1) * MINUTE, still, covariance)
    )


def at(minute: int, *calibrations: Calibration):
    checks = {c.take for c in calibrations if c.take.startswith("check")}
    return fixing_at(calibrations, checks, minute * MINUTE, BRACKET_M)


def takes(of) -> list[str]:
    return [c.take for c in of]


def test_checks_that_agree_leave_one_fixing_whose_x_is_the_calibrations():
    all_ = [found("first", 0), found("check1", 10, off_mm=0.4), found("last", 20)]
    fixing = at(12, *all_)
    assert takes(fixing.members) == ["first", "check1", "last"]
    assert takes(fixing.best) == ["first", "last"]
    assert fixing.moved == ""


def test_a_check_that_disagrees_begins_a_fixing_of_its_own():
    all_ = [found("first", 0), found("check1", 10, off_mm=3.0), found("last", 20, off_mm=3.1)]
    before, after = at(5, *all_), at(12, *all_)
    assert takes(before.best) == ["first"]
    assert takes(after.best) == ["last"]  # the check stands beside it
    assert takes(after.members) == ["check1", "last"]
    assert after.moved.startswith("the headset moved by 3.0 mm (+- ")
    assert "between first and check1" in after.moved


def test_alone_in_its_fixing_a_checks_own_x_is_used():
    all_ = [found("first", 0), found("check1", 10, off_mm=3.0), found("check2", 20, off_mm=6.0)]
    assert takes(at(12, *all_).best) == ["check1"]
    assert takes(at(25, *all_).best) == ["check2"]


def test_what_the_uncertainty_explains_is_no_movement():
    all_ = [found("first", 0), found("check1", 10, off_mm=3.0, sigma_mm=2.0)]
    assert at(12, *all_).moved == ""


def test_calibrations_without_hands_between_them_stay_together_for_the_gate_to_refuse():
    all_ = [found("first", 0), found("last", 20, off_mm=5.0)]
    assert takes(at(12, *all_).members) == ["first", "last"]


def test_a_take_is_not_scored_with_what_it_found_itself():
    all_ = [found("first", 0), found("check1", 10)]
    assert takes(at(10, *all_).without("check1").members) == ["first"]
