import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vrbench.errors import EstimationError
from vrbench.estimation.clock import estimate_clock
from vrbench.estimation.trim import active_window
from vrbench.geometry import Transform, quat_multiply, rotvec_to_quat
from vrbench.trajectory import NS, Trajectory

NOISE = (1e-3, np.radians(0.1))


@settings(max_examples=15, deadline=None)
@given(offset_s=st.floats(-5.0, 5.0), seed=st.integers(0, 1000))
def test_the_offset_is_found_within_half_a_millisecond(truth, offset_s, seed):
    head = truth(seed)
    estimate = head.estimate(45.0, offset_s=offset_s, noise=NOISE, seed=seed)
    found = estimate_clock(head.reference(45.0), estimate)
    assert found.offset_s == pytest.approx(offset_s, abs=5e-4)
    assert found.skew == 0.0
    assert found.correlation > 0.99
    assert found.distinctness > 1.1


def test_the_clock_maps_the_estimates_time_to_the_references(truth):
    head = truth(1)
    reference, estimate = head.reference(40.0), head.estimate(40.0, offset_s=-0.264)
    clock = estimate_clock(reference, estimate).clock
    assert clock.to_reference(estimate.t[:1])[0] == pytest.approx(reference.t[0], abs=2e5)


@pytest.mark.parametrize("rate_hz", [30.0, 100.0, 500.0])
def test_any_rate_of_the_reference_will_do(truth, rate_hz):
    head = truth(2)
    estimate = head.estimate(30.0, 90.0, offset_s=0.123, noise=NOISE)
    found = estimate_clock(head.reference(30.0, rate_hz), estimate)
    assert found.offset_s == pytest.approx(0.123, abs=5e-4)


def test_frames_do_not_matter(truth):
    head = truth(3)
    reference, estimate = head.reference(30.0), head.estimate(30.0, offset_s=0.05)
    turn = Transform(np.ones(3), rotvec_to_quat(np.array([1.0, 2.0, 0.5])))
    moved = estimate.mapped(lambda pose: turn @ pose @ turn.inverse())
    assert (
        estimate_clock(reference, moved).offset_s
        == pytest.approx(estimate_clock(reference, estimate).offset_s, abs=1e-6)
    )  # fmt: skip


def test_clocks_minutes_apart_are_bridged(truth):
    head = truth(4)
    reference = head.reference(40.0)
    estimate = head.estimate(40.0, offset_s=250.0, noise=NOISE)
    assert estimate_clock(reference, estimate).offset_s == pytest.approx(250.0, abs=5e-4)


def test_disjoint_streams_are_refused_with_both_spans(truth):
    head = truth(5)
    reference, estimate = head.reference(40.0), head.estimate(40.0, offset_s=3600.0)
    with pytest.raises(EstimationError, match="do not overlap in time") as refused:
        estimate_clock(reference, estimate)
    for stream in (reference, estimate):
        assert f"{stream.t[0] / NS:.3f} to {stream.t[-1] / NS:.3f} s" in str(refused.value)
    with pytest.raises(EstimationError, match="do not overlap"):
        estimate_clock(reference, head.estimate(40.0, offset_s=50.0), search_s=1.0)
    found = estimate_clock(reference, estimate, around_s=3599.0, search_s=2.0)
    assert found.offset_s == pytest.approx(3600.0, abs=5e-4)


def test_an_uptime_clock_is_bridged_when_it_is_known_roughly(truth):
    head = truth(5)
    reference, estimate = head.reference(40.0), head.estimate(40.0, offset_s=0.2)
    uptime = Trajectory(estimate.t - 1_706_600_000 * NS, estimate.pose)
    found = estimate_clock(reference, uptime, around_s=-1_706_600_000.0, search_s=5.0)
    assert found.offset_s + 1_706_600_000 == pytest.approx(0.2, abs=5e-4)


def looped(head, loops: int, loop_s: float, noise: float, seed: int) -> tuple:
    """A motion of `loop_s` again and again: reference, and estimate at an offset of 0.3 s."""
    rng = np.random.default_rng(seed)
    streams = []
    for rate, offset in ((30.0, 0.0), (72.0, 0.3)):
        s = np.arange(0.0, loops * loop_s, 1.0 / rate)
        phase = 2 * np.pi * s / loop_s
        r = sum(
            np.sin(k * phase)[:, None] * head.amplitude[3:, k]
            + np.cos(k * phase)[:, None] * 0.05 / k
            for k in range(1, 8)
        )
        q = quat_multiply(rotvec_to_quat(r), rotvec_to_quat(noise * rng.normal(size=(len(s), 3))))
        t = np.rint((s + offset) * NS).astype(np.int64)
        streams.append(Trajectory(t, Transform(np.zeros((len(s), 3)), q)))
    return tuple(streams)


def test_looped_motion_needs_a_bounded_search(truth):
    reference, estimate = looped(truth(6), 20, 12.0, 1e-4, 1)
    with pytest.raises(EstimationError, match="two offsets fit alike"):
        estimate_clock(reference, estimate)
    found = estimate_clock(reference, estimate, search_s=5.0)
    assert found.offset_s == pytest.approx(0.3, abs=5e-4)


def test_lost_tracking_is_masked(truth):
    head = truth(7)
    reference = head.reference(120.0)
    estimate = head.estimate(120.0, offset_s=-0.1, noise=NOISE)
    s = estimate.seconds(int(estimate.t[0]))
    lost = (s > 40.0) & (s < 70.0)
    found = estimate_clock(reference, estimate[~lost])
    assert found.offset_s == pytest.approx(-0.1, abs=5e-4)
    assert found.overlap_s == pytest.approx(90.0, abs=1.0)
    assert found.correlation > 0.99


def test_jumps_of_the_tracking_do_not_matter(truth):
    head = truth(8)
    reference, estimate = head.reference(90.0), head.estimate(90.0, offset_s=0.7, noise=NOISE)
    rng = np.random.default_rng(1)
    bad = rng.choice(len(estimate), len(estimate) // 50, replace=False)
    turn = rotvec_to_quat(rng.normal(0.0, 0.7, (len(bad), 3)))
    estimate.pose.q[bad] = quat_multiply(turn, estimate.pose.q[bad])
    assert estimate_clock(reference, estimate).offset_s == pytest.approx(0.7, abs=2e-3)


def test_repeated_poses_do_not_matter(truth):
    head = truth(9)
    estimate = head.estimate(60.0, 144.0, offset_s=0.4, noise=NOISE)
    held = np.arange(len(estimate)) // 2 * 2
    repeated = Trajectory(estimate.t, estimate.pose[held])
    # every second pose is 1/144 s old
    found = estimate_clock(head.reference(60.0), repeated)
    assert found.offset_s == pytest.approx(0.4 + 0.5 / 144, abs=5e-4)


def test_other_motions_are_refused(truth):
    with pytest.raises(EstimationError, match="correlate by"):
        estimate_clock(truth(10).reference(60.0), truth(11).estimate(60.0))


@pytest.mark.parametrize("still", ["reference", "estimate"])
def test_constant_poses_are_refused(truth, still):
    head = truth(12)
    reference, estimate = head.reference(30.0), head.estimate(30.0, noise=NOISE)
    rng = np.random.default_rng(0)
    jitter = Transform(
        1e-4 * rng.normal(size=estimate.pose.p.shape),
        rotvec_to_quat(2e-4 * rng.normal(size=estimate.pose.p.shape)),
    )
    if still == "reference":
        reference = Trajectory(reference.t, jitter[: len(reference)])
    else:
        estimate = Trajectory(estimate.t, jitter)
    with pytest.raises(EstimationError, match=f"{still}: hardly turns"):
        estimate_clock(reference, estimate)


def test_pure_translation_is_refused(truth):
    head = truth(13, (1, 1, 1, 0, 0, 0))
    with pytest.raises(EstimationError, match="hardly turns"):
        estimate_clock(head.reference(30.0), head.estimate(30.0, noise=NOISE))


def test_too_few_poses_seconds_or_nan_are_refused(truth):
    head = truth(14)
    reference, estimate = head.reference(30.0), head.estimate(30.0)
    with pytest.raises(EstimationError, match="estimate: only 10 poses"):
        estimate_clock(reference, estimate[:10])
    with pytest.raises(EstimationError, match=r"estimate: lasts 1\.38 s"):
        estimate_clock(reference, estimate[:100])
    estimate.pose.q[3] = np.nan
    with pytest.raises(EstimationError, match="estimate: quaternion of pose 4"):
        estimate_clock(reference, estimate)


def test_skew_is_fitted_past_ten_minutes(truth):
    head = truth(15)
    reference = head.reference(1200.0)
    estimate = head.estimate(1200.0, 60.0, offset_s=0.5, skew=25e-6, noise=NOISE)
    found = estimate_clock(reference, estimate)
    assert found.skew == pytest.approx(25e-6, abs=1.5e-6)
    assert found.offset_s == pytest.approx(0.5, abs=5e-4)
    assert found.residual_s is not None
    assert found.residual_s < 2e-3
    assert len(found.clock.knots) == 2


def bent(estimate: Trajectory, at_s: float, slope: float) -> Trajectory:
    """The estimate on a clock that runs away by `slope` from `at_s` on."""
    s = estimate.seconds(int(estimate.t[0]))
    extra = np.rint(np.maximum(s - at_s, 0.0) * slope * NS).astype(np.int64)
    return Trajectory(estimate.t + extra, estimate.pose)


def test_a_clock_that_changes_its_rate_is_piecewise_affine(truth):
    head = truth(16)
    reference = head.reference(1500.0)
    straight = head.estimate(1500.0, 60.0, noise=NOISE)
    estimate = bent(straight, 750.0, 80e-6)
    clock = estimate_clock(reference, estimate).clock
    assert len(clock.knots) > 2
    assert np.diff(clock.knots).min() >= 120 * NS
    error = clock.to_reference(estimate.t) - straight.t
    assert np.abs(error).max() < 4e6


@pytest.mark.parametrize("step_s", [2.0, 0.01])
def test_a_clock_that_was_set_has_a_step(truth, step_s):
    head = truth(17)
    reference = head.reference(240.0)
    estimate = head.estimate(240.0, noise=NOISE)
    half = len(estimate) // 3
    t = estimate.t + np.where(np.arange(len(estimate)) < half, 0, int(step_s * NS))
    stepped = Trajectory(t, estimate.pose)
    found = estimate_clock(reference, stepped, steps_ns=[int(t[half])])
    assert np.abs(found.clock.to_reference(t) - estimate.t).max() < 5e5


def test_a_step_nobody_told_of_is_refused(truth):
    head = truth(17)
    estimate = head.estimate(240.0, noise=NOISE)
    t = estimate.t + np.where(np.arange(len(estimate)) < len(estimate) // 2, 0, 2 * NS)
    with pytest.raises(EstimationError):
        estimate_clock(head.reference(240.0), Trajectory(t, estimate.pose))


@pytest.mark.parametrize("step_s", [0.05, -0.1])
def test_a_step_nobody_told_of_in_a_long_take_is_named(truth, step_s):
    head = truth(17)
    estimate = head.estimate(700.0, 60.0, noise=NOISE, skew=20e-6)
    half = len(estimate) // 2
    t = estimate.t + np.where(np.arange(len(estimate)) < half, 0, int(step_s * NS))
    t, first = np.unique(t, return_index=True)
    stepped = Trajectory(t, estimate.pose[first])
    with pytest.raises(EstimationError, match=r"clock jumps by .* was set") as told:
        estimate_clock(head.reference(700.0), stepped)
    jump_ms = float(str(told.value).split("jumps by ")[1].split(" ms")[0])
    assert jump_ms == pytest.approx(1e3 * step_s, abs=8.0)
    near_s = float(str(told.value).split(" near ")[1].split(" s")[0])
    assert abs(near_s - estimate.t[half] / NS) < 60.0


def test_a_stretch_too_short_for_a_clock_is_named(truth):
    head = truth(18)
    estimate = head.estimate(60.0, noise=NOISE)
    with pytest.raises(EstimationError, match=r"estimate from .* tracked for 1\.\d+ s only"):
        estimate_clock(head.reference(60.0), estimate, steps_ns=[int(estimate.t[-100])])


def test_a_peak_at_the_border_of_the_search_is_refused(truth):
    head = truth(19)
    with pytest.raises(EstimationError, match="still grows where the search ends"):
        estimate_clock(head.reference(60.0), head.estimate(60.0, offset_s=0.15), search_s=0.1)


EXPECTED = {
    ("quest2", "calib"): -0.2640,
    ("quest2", "traj1"): -0.2602,
    ("quest_pro", "calib"): -0.0239,
    ("quest_pro", "traj1"): -0.0163,
}


@pytest.mark.parametrize("key", EXPECTED, ids="-".join)
def test_recordings(recordings, key):
    take = recordings[key]
    found = estimate_clock(take.tcp.between(*active_window(take.tcp)), take.eye)
    assert found.offset_s == pytest.approx(EXPECTED[key], abs=2.5e-3)
    assert found.correlation > 0.997
    assert found.distinctness > 2.0
    assert found.residual_s < 5e-3
    # idle and brake change next to nothing
    assert estimate_clock(take.tcp, take.eye).offset_s == pytest.approx(found.offset_s, abs=1e-3)
