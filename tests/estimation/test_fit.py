import numpy as np
import pytest

from vrbench.clocks import ClockMap
from vrbench.errors import EstimationError
from vrbench.estimation.alignment import align
from vrbench.estimation.clock import estimate_clock
from vrbench.estimation.fit import fit
from vrbench.estimation.handeye import solve_handeye
from vrbench.estimation.interpolation import PoseSpline, paired
from vrbench.estimation.model import PARAMETERS, Model, State
from vrbench.estimation.trim import active_window
from vrbench.geometry import (
    Transform,
    quat_conjugate,
    quat_multiply,
    quat_to_rotvec,
    relative_angle,
    rotvec_to_quat,
)
from vrbench.trajectory import NS, Trajectory

NOISE = (1e-3, np.radians(0.1))
CALIBRATION = ("offset", "x", "y", "scale")


def near(transform: Transform, m: float, deg: float, seed: int = 0) -> Transform:
    rng = np.random.default_rng(seed)
    turn = rotvec_to_quat(np.radians(deg) * rng.normal(size=3))
    return Transform(transform.p + m * rng.normal(size=3), quat_multiply(transform.q, turn))


def calibrate(head, estimate, reference, offset_s, **options):
    """From a start 5 ms, some centimetres and degrees off."""
    clock = ClockMap.affine(int(estimate.t[0]), offset_s + 0.005)
    return fit(
        reference,
        estimate,
        clock=clock,
        x=near(head.x, 0.02, 2.0),
        y=near(head.y, 0.02, 2.0, 1),
        free=options.pop("free", CALIBRATION),
        **options,
    )


def offset_error(result, offset_s: float) -> float:
    middle = result.t[len(result.t) // 2]
    return float(result.clock.offset_ns(middle)) / NS - offset_s


def test_derivatives_are_those_of_the_residuals(truth):
    head = truth(1)
    reference = head.reference(20.0, 100.0)
    estimate = head.estimate(20.0, offset_s=0.1, noise=(0.02, 0.05))
    estimate = estimate[100:-100]
    names = tuple(name for group in PARAMETERS.values() for name in group)
    clock = ClockMap.affine(int(estimate.t[0]), 0.11)
    model = Model(PoseSpline(reference), clock, estimate, names)
    y = near(head.y, 0.01, 1.0)
    state = State(0.001, 1e-4, near(head.x, 0.01, 1.0), y.q, y.apply(model.mean_p), 1.02)
    *_, d_p, d_r = model.linearised(state, slice(0, len(model)))
    for k in range(len(names)):
        step = np.eye(len(names))[k] * 1e-5
        plus = model.residuals(state.moved(names, step))
        minus = model.residuals(state.moved(names, -step))
        for analytic, a, b in zip((d_p, d_r), plus, minus, strict=True):
            numeric = (a - b) / 2e-5
            size = max(np.abs(numeric).max(), 1.0)
            assert np.abs(analytic[:, :, k] - numeric).max() < 2e-4 * size, names[k]


def test_exact_data_give_the_truth(truth):
    head = truth(2)
    estimate = head.estimate(60.0, offset_s=-0.264, scale=1.01)
    found = calibrate(head, estimate, head.reference(60.0, 100.0), -0.264)
    assert offset_error(found, -0.264) == pytest.approx(0.0, abs=1e-6)
    assert found.x.p == pytest.approx(head.x.p, abs=1e-6)
    assert relative_angle(found.x.q, head.x.q) < 1e-6
    assert relative_angle(found.y.q, head.y.q) < 1e-6
    assert found.scale == pytest.approx(1.01, abs=1e-6)
    # Y brings the mean eye position home with or without the scale
    tcp = head.tcp(np.arange(0.0, 60.0, 1 / 72))
    eye = (tcp @ head.x).p.mean(axis=0)
    assert found.y.apply(found.scale_centre) == pytest.approx(eye, abs=1e-3)


@pytest.mark.parametrize("free", [("offset", "y"), (*CALIBRATION, "skew")])
def test_a_stream_against_itself_is_fitted(truth, free):
    """The first thing anybody tries. Every residual is nought, or the last digit."""
    for rate_hz in (72.0, 100.0):
        same = truth(1).reference(30.0, rate_hz)
        found = fit(
            same,
            same,
            clock=ClockMap.affine(int(same.t[0]), 0.0),
            x=Transform.identity(),
            free=free,
        )
        assert offset_error(found, 0.0) == pytest.approx(0.0, abs=1e-8)
        assert np.abs(found.translation).max() < 1e-9


def test_errors_that_follow_the_motion_are_no_noise(truth):
    """The offset is no less certain beside an error of scale."""
    head = truth(4)
    reference = head.reference(60.0)
    clock = ClockMap.affine(int(reference.t[0]), 0.0)
    sigmas = [
        fit(reference, head.estimate(60.0, scale=scale, noise=NOISE), clock=clock, x=head.x).sigma(
            "offset"
        )
        for scale in (1.0, 1.02)
    ]
    assert sigmas[1] == pytest.approx(sigmas[0], rel=0.1)


def test_x_under_real_noise(truth):
    """A 4-minute calibration, 1 mm and 0.1 deg rms of noise that lasts 2 s, 1 % of scale."""
    errors = []
    for seed in range(4):
        head = truth(seed)
        estimate = head.estimate(240.0, offset_s=-0.264, scale=1.01, noise=NOISE, seed=seed)
        found = calibrate(head, estimate, head.reference(240.0), -0.264)
        turn = quat_to_rotvec(quat_multiply(quat_conjugate(head.x.q), found.x.q))
        errors.append(
            (
                offset_error(found, -0.264) * 1e3,
                np.linalg.norm(found.x.p - head.x.p) * 1e3,
                np.degrees(np.linalg.norm(turn)),
                found.scale - 1.01,
            )
        )
    offset_ms, x_mm, x_deg, scale = np.abs(errors).T
    assert offset_ms.max() < 0.5
    assert np.sqrt(np.mean(x_mm**2)) < 0.5
    assert np.sqrt(np.mean(x_deg**2)) < 0.03
    assert scale.max() < 1e-3


def test_sigmas_are_as_large_as_the_errors(truth):
    """Formal ones, of samples taken as independent, would be some ten times too small."""
    ratios = []
    for seed in range(16):
        head = truth(seed)
        estimate = head.estimate(60.0, offset_s=0.1, noise=NOISE, seed=seed)
        found = calibrate(head, estimate, head.reference(60.0), 0.1, free=("offset", "x", "y"))
        turn = quat_to_rotvec(quat_multiply(quat_conjugate(head.x.q), found.x.q))
        ratios += [offset_error(found, 0.1) / found.sigma("offset")]
        ratios += [(found.x.p - head.x.p)[i] / found.sigma(f"x.p{a}") for i, a in enumerate("xyz")]
        ratios += [turn[i] / found.sigma(f"x.r{a}") for i, a in enumerate("xyz")]
        error = found.y.p - head.y.p
        ratios += [error[i] / found.sigma(f"y.p{a}") for i, a in enumerate("xyz")]
    assert 0.8 < np.sqrt(np.mean(np.square(ratios))) < 1.4


def test_a_scored_take_has_seven_parameters_and_keeps_x(truth):
    head = truth(3)
    reference = head.reference(60.0)
    estimate = head.estimate(60.0, offset_s=0.1, noise=NOISE)
    clock = estimate_clock(reference, estimate).clock
    found = fit(reference, estimate, clock=clock, x=head.x)
    assert len(found.names) == 7
    assert found.x is head.x
    assert found.scale == 1.0
    assert offset_error(found, 0.1) == pytest.approx(0.0, abs=5e-4)
    assert relative_angle(found.y.q, head.y.q) < np.radians(0.05)
    assert np.sqrt(np.mean(np.sum(found.translation**2, axis=1))) == pytest.approx(1e-3, rel=0.2)
    assert len(found.t) == len(found.translation) == len(found.rotation)


def test_an_anchor_alone_gives_y(truth):
    head = truth(4)
    estimate = head.estimate(60.0, offset_s=0.1, noise=NOISE)
    clock = ClockMap.affine(int(estimate.t[0]), 0.1)
    anchor = estimate.between(int(estimate.t[0]), int(estimate.t[0]) + 10 * NS)
    found = fit(head.reference(60.0), anchor, clock=clock, x=head.x, free=("y",))
    assert found.names == PARAMETERS["y"]
    assert found.clock.offset_ns(estimate.t) == pytest.approx(clock.offset_ns(estimate.t))
    assert relative_angle(found.y.q, head.y.q) < np.radians(0.2)


def test_pure_translation_scores_but_does_not_calibrate(truth):
    head = truth(5, (1, 1, 1, 0, 0, 0))
    reference, estimate = head.reference(60.0), head.estimate(60.0, noise=NOISE)
    clock = ClockMap.affine(int(estimate.t[0]), 0.004)
    found = fit(reference, estimate, clock=clock, x=head.x)
    assert offset_error(found, 0.0) == pytest.approx(0.0, abs=1e-3)
    with pytest.raises(EstimationError, match="does not turn"):
        calibrate(head, estimate, reference, 0.0)


def test_rotation_about_one_axis_does_not_calibrate(truth):
    head = truth(6, (1, 1, 1, 1, 0, 0))
    with pytest.raises(EstimationError, match="one axis only"):
        calibrate(head, head.estimate(60.0, noise=NOISE), head.reference(60.0), 0.0)


def test_constant_poses_leave_the_offset_open(truth):
    head = truth(7, (0, 0, 0, 0, 0, 0))
    reference, estimate = head.reference(60.0), head.estimate(60.0, noise=NOISE)
    with pytest.raises(EstimationError, match="offset"):
        fit(reference, estimate, clock=ClockMap.affine(int(estimate.t[0]), 0.0), x=head.x)


def test_a_fifth_of_outliers_moves_little(truth):
    head = truth(8)
    reference = head.reference(60.0)
    estimate = head.estimate(60.0, offset_s=0.1, noise=NOISE)
    clean = calibrate(head, estimate, reference, 0.1)
    rng = np.random.default_rng(0)
    bad = rng.choice(len(estimate), len(estimate) // 5, replace=False)
    estimate.pose.p[bad] += rng.normal(0.0, 0.3, (len(bad), 3))
    turn = rotvec_to_quat(rng.normal(0.0, 0.5, (len(bad), 3)))
    estimate.pose.q[bad] = quat_multiply(estimate.pose.q[bad], turn)
    found = calibrate(head, estimate, reference, 0.1)
    assert offset_error(found, 0.1) == pytest.approx(offset_error(clean, 0.1), abs=3e-4)
    assert found.x.p == pytest.approx(clean.x.p, abs=5e-4)
    assert relative_angle(found.x.q, clean.x.q) < np.radians(0.03)


@pytest.mark.parametrize("lost", ["estimate", "reference"])
def test_thirty_seconds_lost_are_left_out(truth, lost):
    head = truth(9)
    reference, estimate = head.reference(120.0), head.estimate(120.0, offset_s=0.1, noise=NOISE)
    streams = {"reference": reference, "estimate": estimate}
    s = streams[lost].seconds(int(streams[lost].t[0]))
    streams[lost] = streams[lost][(s < 40.0) | (s > 70.0)]
    found = calibrate(head, streams["estimate"], streams["reference"], 0.1)
    assert offset_error(found, 0.1) == pytest.approx(0.0, abs=5e-4)
    gap = (found.t - found.t[0]) / NS
    assert not ((gap > 41.0) & (gap < 69.0)).any()
    assert np.isfinite(found.translation).all()


def test_repeated_poses_and_any_sign_of_a_quaternion_change_little(truth):
    head = truth(10)
    reference, estimate = head.reference(60.0), head.estimate(60.0, offset_s=0.1, noise=NOISE)
    found = calibrate(head, estimate, reference, 0.1)
    estimate.pose.q[::2] *= -1.0
    reference.pose.q[::3] *= -1.0
    again = calibrate(head, estimate, reference, 0.1)
    assert again.x.p == pytest.approx(found.x.p, abs=1e-9)


def test_skew_has_a_prior_under_ten_minutes(truth):
    head = truth(11)
    reference = head.reference(60.0)
    estimate = head.estimate(60.0, offset_s=0.1, noise=(5e-3, np.radians(0.5)))
    free = ("offset", "skew", "y")
    clock = ClockMap.affine(int(estimate.t[0]), 0.1)
    found = fit(reference, estimate, clock=clock, x=head.x, free=free)
    assert found.sigma("skew") < 50.1e-6
    slope = np.diff(found.clock.offsets)[0] / np.diff(found.clock.knots)[0]
    assert abs(slope) < 60e-6


def test_skew_of_two_hours_within_a_tenth_of_a_ppm(truth):
    head = truth(12)
    reference = head.reference(7200.0, 12.0)
    estimate = head.estimate(7200.0, 15.0, offset_s=0.5, skew=25e-6, noise=NOISE)
    first = estimate_clock(reference, estimate)
    assert first.skew == pytest.approx(25e-6, abs=0.1e-6)
    free = ("offset", "skew", "y")
    found = fit(reference, estimate, clock=first.clock, x=head.x, free=free)
    slope = np.diff(found.clock.offsets)[0] / np.diff(found.clock.knots)[0]
    assert slope == pytest.approx(25e-6, abs=0.1e-6)
    assert abs(slope - 25e-6) < 4.0 * found.sigma("skew")
    assert offset_error(found, 0.5) == pytest.approx(0.0, abs=5e-4)


def test_a_piecewise_clock_keeps_its_shape(truth):
    head = truth(16)
    reference, straight = head.reference(60.0), head.estimate(60.0, noise=NOISE)
    middle = int(straight.t[0]) + 30 * NS
    extra = np.rint(np.abs(straight.t - middle) * 1e-3).astype(np.int64)
    estimate = Trajectory(straight.t + extra, straight.pose)
    knots = estimate.t[[0, len(estimate) // 2, -1]]
    clock = ClockMap(knots, extra[[0, len(estimate) // 2, -1]] + 0.004 * NS)
    found = fit(reference, estimate, clock=clock, x=head.x)
    assert np.array_equal(found.clock.knots, knots)
    assert np.abs(found.clock.to_reference(estimate.t) - straight.t).max() < 5e5


def test_slow_drift_of_the_world_does_not_reach_x(truth):
    head = truth(13)
    reference, estimate = head.reference(240.0), head.estimate(240.0, noise=NOISE)
    s = estimate.seconds(int(estimate.t[0]))
    angle = np.radians(0.3) * np.sin(2 * np.pi * s / 150.0)
    way = 0.01 * np.cos(2 * np.pi * s / 200.0)
    world = Transform(way[:, None] * np.ones(3), rotvec_to_quat(angle[:, None] * np.eye(3)[1]))
    drifting = Trajectory(estimate.t, world @ estimate.pose)
    found = calibrate(head, drifting, reference, 0.0)
    assert np.linalg.norm(found.x.p - head.x.p) < 3e-3


def test_bad_input_is_refused(truth):
    head = truth(15)
    reference, estimate = head.reference(30.0), head.estimate(30.0, noise=NOISE)
    clock = ClockMap.affine(int(estimate.t[0]), 0.0)
    with pytest.raises(EstimationError, match="only 10 poses"):
        fit(reference, estimate[:10], clock=clock, x=head.x)
    with pytest.raises(EstimationError, match="within the reference's time"):
        fit(reference, estimate, clock=ClockMap.affine(int(estimate.t[0]), 60.0), x=head.x)
    with pytest.raises(ValueError, match="free must be some of"):
        fit(reference, estimate, clock=clock, x=head.x, free=("offsets",))
    with pytest.raises(EstimationError, match=r"offset moved by -0\.2"):
        start = ClockMap.affine(int(estimate.t[0]), 0.2)
        fit(reference, estimate, clock=start, x=head.x, max_offset_change_s=0.1)
    estimate.pose.p[11] = np.nan
    with pytest.raises(EstimationError, match="position of pose 12"):
        fit(reference, estimate, clock=clock, x=head.x)


@pytest.mark.parametrize(
    ("device", "offsets", "rmse_mm"),
    [("quest2", (-0.2640, -0.2602), 1.81), ("quest_pro", (-0.0239, -0.0163), 1.85)],
)
def test_recordings(recordings, device, offsets, rmse_mm):
    """X from calib alone, then traj1 at the tcp after SE(3) alignment."""
    take = recordings[device, "calib"]
    reference = PoseSpline(take.tcp.between(*active_window(take.tcp)))
    clock = estimate_clock(take.tcp, take.eye).clock
    covered, tcp = paired(reference, take.eye, clock)
    start = solve_handeye(tcp, take.eye.pose[covered])
    free = ("skew", *CALIBRATION)
    calibration = fit(reference, take.eye, clock=clock, x=start.x, y=start.y, free=free)
    assert offset_error(calibration, offsets[0]) == pytest.approx(0.0, abs=1.5e-3)
    # thirds of calib scatter by 0.1 to 0.2 ms about a clock that gains 20 to 30 ppm
    assert 5e-5 < calibration.sigma("offset") < 5e-4

    take = recordings[device, "traj1"]
    reference = PoseSpline(take.tcp.between(*active_window(take.tcp)))
    clock = estimate_clock(take.tcp, take.eye).clock
    scored = fit(reference, take.eye, clock=clock, x=calibration.x)
    assert offset_error(scored, offsets[1]) == pytest.approx(0.0, abs=1.5e-3)
    covered, tcp = paired(reference, take.eye, scored.clock)
    p = (take.eye.pose[covered] @ calibration.x.inverse()).p
    error = tcp.p - align(tcp.p, p).apply(p)
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) * 1e3 < rmse_mm
