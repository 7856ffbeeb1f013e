"""Families that watch the error over time: rest, drift, jumps, losses."""

import numpy as np
import pytest

from vrbench.errors import EstimationError
from vrbench.geometry import Transform, quat_multiply, rotvec_to_quat
from vrbench.metrics import (
    allan,
    drift,
    jitter,
    jumps,
    recovery,
    rest,
    return_to_start,
    robust,
    tilt,
)
from vrbench.trajectory import NS, Trajectory


def stop_and_go(s, speed=0.2):
    """Moves, rests from 5 s to 15 s, moves."""
    moving = np.clip(s, 0, 5) + np.clip(s - 15, 0, None)
    p = np.stack([speed * np.sin(moving), speed * moving, 0 * s], axis=1)
    return Transform(p, rotvec_to_quat(np.stack([0 * s, 0.1 * moving, 0 * s], axis=1)))


def test_rest_is_found_where_it_is(make_take):
    slots = rest.rest_slots(make_take(path=stop_and_go).reference)
    assert slots.tolist() == list(range(5, 15))


@pytest.mark.parametrize("mm_per_s", [0.3, 1.0, 10.0])
def test_creeping_is_not_rest(make_take, mm_per_s):
    def creep(s):
        p = np.outer(s, [mm_per_s / 1e3, 0, 0])
        return Transform(p, np.tile([0, 0, 0, 1.0], (len(s), 1)))

    assert len(rest.rest_slots(make_take(path=creep).reference)) == 0


def test_rest_is_found_through_the_noise_of_motion_capture():
    rng = np.random.default_rng(0)
    t = np.arange(1200, dtype=np.int64) * (NS // 120)
    pose = Transform(
        rng.normal(0, 0.6e-4, (1200, 3)), rotvec_to_quat(rng.normal(0, 5e-4, (1200, 3)))
    )
    assert len(rest.rest_slots(Trajectory(t, pose))) >= 9


def test_jitter_is_the_scatter_at_rest(values, make_take):
    rng = np.random.default_rng(1)

    def spoil(s, pose):
        trembled = rotvec_to_quat(rng.normal(0, np.radians(0.02), (len(s), 3)))
        p = pose.p + rng.normal(0, 0.0003, pose.p.shape)
        return Transform(p, quat_multiply(pose.q, trembled))

    found = values(jitter.FAMILY, make_take(path=stop_and_go, spoil=spoil))
    position = found["jitter.position", "eye", "all", "rmse"]
    assert position.value == pytest.approx(0.3 * np.sqrt(3), rel=0.1)
    assert position.samples == pytest.approx(720, abs=2)
    rotation = found["jitter.rotation", "eye", "all", "rmse"]
    assert rotation.value == pytest.approx(0.02 * np.sqrt(3), rel=0.1)


def test_without_rest_there_is_no_jitter(values, make_take):
    found = values(jitter.FAMILY, make_take())
    assert "never at rest" in found["jitter.position", "", "all", "rmse"].reason


def test_allan_deviation_of_white_noise_falls_with_the_root_of_time():
    rng = np.random.default_rng(2)
    t = np.arange(100_000, dtype=np.int64) * (NS // 100)
    error = rng.normal(size=(len(t), 3))
    for tau in (0.1, 1.0, 10.0):
        found, _ = allan.allan_deviation(t, error, tau)
        assert found == pytest.approx(np.sqrt(3 / (100 * tau)), rel=0.12)
    with pytest.raises(EstimationError):
        allan.allan_deviation(t, error, 300.0)


def test_allan_values_or_reasons(values, make_take):
    found = values(allan.FAMILY, make_take())
    assert found["allan@1s", "eye", "all", "value"].value == pytest.approx(0, abs=1e-6)
    assert "stretches of 100 s" in found["allan@100s", "eye", "all", "value"].reason


def leaning(rate_rad_per_s, axis):
    """Errors of rotation about an axis of base, growing at a rate."""

    def spoil(s, pose):
        turn = rotvec_to_quat(np.outer(rate_rad_per_s * s, axis))
        return Transform(pose.p, quat_multiply(turn, pose.q))

    return spoil


def up_of(take):
    return tilt.up_in_base(take.truth @ take.x, take.estimate.pose)[0]


def test_tilt_sees_leaning_and_not_yaw(values, make_take):
    up = up_of(make_take())
    across = np.cross(up, [1.0, 0, 0])
    across /= np.linalg.norm(across)
    rate = np.radians(0.1)
    leans = values(tilt.FAMILY, make_take(20.0, spoil=leaning(rate, across)))
    # Means of the first and the last five seconds lie 15 s apart.
    assert leans["tilt", "", "all", "last-first"].value == pytest.approx(1.5, rel=0.01)
    yaws = values(tilt.FAMILY, make_take(20.0, spoil=leaning(rate, up)))
    assert yaws["tilt", "", "all", "last-first"].value == pytest.approx(0, abs=1e-5)


def test_tilt_between_takes_is_measured_to_the_first(make_take):
    up = up_of(make_take())
    across = np.cross(up, [1.0, 0, 0])
    across /= np.linalg.norm(across)

    def leaned(_s, pose):
        turn = rotvec_to_quat(np.radians(0.3) * across)
        return Transform(pose.p, quat_multiply(np.broadcast_to(turn, pose.q.shape), pose.q))

    rows = {v.statistic: v for v in tilt.of_repeats([make_take(), make_take(spoil=leaned)])}
    assert rows["max"].value == pytest.approx(0.3, rel=1e-6)


def test_drift_is_split_into_translation_yaw_and_tilt(values, make_take):
    up = up_of(make_take())
    per_hour = np.radians(1.0) / 3600

    def spoil(s, pose):
        turned = leaning(-2 * per_hour, up)(s, pose)
        return Transform(pose.p + np.outer(s / 3600, [0.006, 0, 0.008]), turned.q)

    found = values(drift.FAMILY, make_take(900.0, rate=10.0, spoil=spoil))
    assert found["drift.translation", "eye", "all", "slope"].value == pytest.approx(10, rel=0.05)
    assert found["drift.yaw", "eye", "all", "slope"].value == pytest.approx(-2, rel=0.05)
    assert found["drift.tilt", "eye", "all", "slope"].value == pytest.approx(0, abs=0.02)


def test_a_short_take_has_no_drift(values, make_take):
    found = values(drift.FAMILY, make_take())
    assert "drift needs 600 s" in found["drift.yaw", "eye", "all", "slope"].reason


def test_return_to_start_is_the_error_that_has_come_up(values, make_take):
    def spoil(s, pose):
        return Transform(pose.p + np.outer(s > 10, [0.003, 0.004, 0]), pose.q)

    found = values(return_to_start.FAMILY, make_take(spoil=spoil))
    for point in ("eye", "tcp"):
        row = found["return_to_start", point, "all", "last-first"]
        assert row.value == pytest.approx(5.0, abs=1e-6)


def test_jumps_are_counted_and_sized(values, make_take):
    def spoil(s, pose):
        return Transform(pose.p + np.outer((s > 5) * 0.03 + (s > 12) * 0.02, [0, 1, 0]), pose.q)

    found = values(jumps.FAMILY, make_take(spoil=spoil))
    assert found["jumps", "eye", "all", "count"].value == 2
    assert found["jumps.size", "eye", "all", "max"].value == pytest.approx(30, abs=0.5)
    none = values(jumps.FAMILY, make_take())
    assert none["jumps", "eye", "all", "count"].value == 0
    assert none["jumps.size", "eye", "all", "max"].value is None


def lost(s):
    return (s < 8.0) | (s > 9.0)


def test_recovery_takes_the_loss_and_the_time_until_the_error_is_gone(values, make_take):
    def spoil(s, pose):
        off = ((s > 9) & (s < 11)) * 0.02
        return Transform(pose.p + np.outer(off, [1, 0, 0]), pose.q)

    found = values(recovery.FAMILY, make_take(keep=lost, spoil=spoil))
    assert found["recovery.time", "eye", "all", "max"].value == pytest.approx(3.0, abs=0.03)
    assert found["recovery.offset", "eye", "all", "max"].value == pytest.approx(20, abs=0.01)
    assert found["recovery.offset", "eye", "all", "max"].samples == 1


def test_an_offset_that_stays_never_recovers(values, make_take):
    def spoil(s, pose):
        return Transform(pose.p + np.outer((s > 8.5) * 0.02, [1, 0, 0]), pose.q)

    found = values(recovery.FAMILY, make_take(keep=lost, spoil=spoil))
    assert "1 of 1 losses never" in found["recovery.time", "eye", "all", "max"].reason
    assert found["recovery.offset", "eye", "all", "mean"].value == pytest.approx(20, abs=0.01)


def test_without_a_loss_there_is_nothing_to_recover_from(values, make_take):
    found = values(recovery.FAMILY, make_take())
    assert "never lost" in found["recovery.time", "eye", "all", "max"].reason


def test_theil_sen_is_not_moved_by_a_fifth_of_outliers():
    rng = np.random.default_rng(3)
    x = np.linspace(0, 10, 2000)
    y = 3 * x + rng.normal(0, 0.1, len(x))
    y[rng.choice(len(x), 400, replace=False)] += 100
    assert robust.theil_sen(x, y) == pytest.approx(3, abs=0.05)
    with pytest.raises(EstimationError):
        robust.theil_sen(np.zeros(5), np.arange(5.0))
