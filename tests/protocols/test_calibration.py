"""Calibrations of a mount: when they can be believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vrbench.geometry import Transform, quat_multiply, rotvec_to_quat
from vrbench.protocols.calibration import Calibration, Limits, gate, mean_x, slip
from vrbench.trajectory import NS

X = Transform.of((0.003, 0.087, 0.276), (0.7071, 0.02, -0.01, 0.7071))
LIMITS = Limits(translation_m=0.015, rotation_rad=0.0087, max_age_s=3600.0, bracket_m=0.001)
SIGMA = 1e-4


def poses(n: int = 200, reach: float = 0.4, seed: int = 0) -> Transform:
    rng = np.random.default_rng(seed)
    return Transform(
        rng.uniform(-reach, reach, (n, 3)), rotvec_to_quat(rng.uniform(-0.6, 0.6, (n, 3)))
    )


def calibration(take: str, minute: float, dx: np.ndarray | None = None, **more) -> Calibration:
    d = np.zeros(6) if dx is None else dx
    x = Transform(X.p + d[3:], quat_multiply(X.q, rotvec_to_quat(d[:3])))
    start = round(minute * 60 * NS)
    known = {
        "take": take,
        "x": x,
        "y": Transform.identity(),
        "translation_residual_m": 0.002,
        "rotation_residual_rad": 0.002,
        "start": start,
        "end": start + 60 * NS,
        "tcp": poses(),
        "x_covariance": SIGMA**2 * np.eye(6),
    }
    return Calibration(**(known | more))


def judged(calibrations, own=None, minute: float = 10.0, tcp: Transform | None = None):
    start = round(minute * 60 * NS)
    inner = poses(reach=0.3)[:50] if tcp is None else tcp
    return gate(calibrations, own, start, start + 60 * NS, inner, LIMITS)


BEFORE, AFTER = calibration("before", 5.0), calibration("after", 15.0)


def test_two_that_agree_make_it_ok() -> None:
    assert judged([BEFORE, AFTER]).status == "ok"


@pytest.mark.parametrize(("one", "told"), [(BEFORE, "after"), (AFTER, "before")])
def test_one_alone_is_no_bracket(one, told) -> None:
    verdict = judged([one])
    assert (verdict.status, verdict.reason) == ("unbracketed", f"no calibration {told}")


def test_none_at_all_is_invalid() -> None:
    assert judged([]).status == "invalid"


@pytest.mark.parametrize("axis", range(6))
def test_a_slip_in_any_direction_is_seen(axis: int) -> None:
    dx = np.zeros(6)
    dx[axis] = 0.003 if axis >= 3 else np.radians(2.0)
    if axis < 3 and np.linalg.norm(np.cross(np.eye(3)[axis], X.inverse().p)) < 0.05:
        pytest.skip("about the lever itself a turn moves nothing")
    verdict = judged([BEFORE, calibration("after", 15.0, dx)])
    assert verdict.status == "invalid"
    assert "calibrations before and after differ by" in verdict.reason


def test_a_slip_within_the_uncertainty_is_none() -> None:
    dx = np.array([0.0, 0.0, 0.0, 0.0015, 0.0, 0.0])
    vague = 0.0005**2 * np.eye(6)
    one = calibration("before", 5.0, x_covariance=vague)
    assert judged([one, calibration("after", 15.0, dx, x_covariance=vague)]).status == "ok"


def test_a_calibration_is_judged_with_the_others() -> None:
    dx = np.array([0.0, 0.0, 0.0, 0.02, 0.0, 0.0])
    own = calibration("own", 10.0, dx)
    assert judged([BEFORE], own).status == "invalid"
    assert judged([BEFORE], calibration("own", 10.0)).status == "ok"


def test_residuals_and_age_are_gated() -> None:
    loose = replace(AFTER, translation_residual_m=0.02)
    assert "leaves 20.00 mm, the gate is 15 mm" in judged([BEFORE, loose]).reason
    turned = replace(AFTER, rotation_residual_rad=0.02)
    assert "the gate is 0.498 deg" in judged([BEFORE, turned]).reason
    assert "min away, the gate is 60 min" in judged([BEFORE], minute=90.0).reason


def test_a_motion_beyond_the_calibration_is_extrapolated() -> None:
    verdict = judged([BEFORE, AFTER], tcp=poses(reach=0.6))
    assert verdict.status == "extrapolated"
    assert "lies outside the calibration" in verdict.reason


def test_the_slip_s_sigma_is_that_of_chance() -> None:
    rng = np.random.default_rng(3)
    root = np.diag([2e-4] * 3 + [3e-4] * 3)
    apart = []
    for _ in range(400):
        a, b = (
            calibration(name, 5.0, root @ rng.normal(size=6), x_covariance=root @ root)
            for name in "ab"
        )
        apart.append(slip(a, b))
    distances, sigmas = np.array(apart).T
    assert np.sqrt(np.mean(distances**2)) == pytest.approx(sigmas.mean(), rel=0.15)


def test_the_mean_of_calibrations_is_surer_than_each_and_not_surer_than_they_agree() -> None:
    x, covariance = mean_x([BEFORE, AFTER])
    assert np.allclose(x.p, X.p)
    assert np.allclose(covariance, SIGMA**2 / 2 * np.eye(6))
    dx = np.full(6, 5 * SIGMA)
    _, stretched = mean_x([BEFORE, calibration("after", 15.0, dx)])
    assert stretched[0, 0] > 4 * covariance[0, 0]
