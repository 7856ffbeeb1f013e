import numpy as np
import pytest

from vrbench.errors import ConfigError
from vrbench.geometry import Transform, relative_angle, rotvec_to_quat
from vrbench.motion.generators import GENERATORS, RATE_HZ, generate
from vrbench.motion.motion import Motion, at_speed, digest_of_name, relative_to_first
from vrbench.trajectory import NS, Trajectory

# A released motion never changes: who wants another motion gives it another name.
RELEASED = {
    "shooter-1": "b5e238a5b4b6f58abb9669fa0a94d9847ed609932d7c24f506be05e4d38a4ffa",
    "saturate-1": "2781ed44832cb8d69eb4291dcf672c8a8ec188f2cc0ebd9a2e26e1f8814aa8e9",
    "saturate-30s-1": "540b40b9515ff57d79b0ae2c97678a32cc2b06936b82ab516a1c43e6ba4c4bed",
}
DURATION_S = {"shooter-1": 120.0, "saturate-1": 120.0, "saturate-30s-1": 30.0}


def rms(x) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


@pytest.mark.parametrize("name", GENERATORS)
def test_a_released_motion_never_changes(name):
    assert generate(name).digest == RELEASED[name]
    assert GENERATORS[name]().digest == RELEASED[name]


@pytest.mark.parametrize("name", GENERATORS)
def test_a_motion_starts_from_the_identity_and_bears_its_name(name):
    motion = generate(name)
    assert motion.name == name
    assert motion.trajectory.t[0] == 0
    np.testing.assert_array_equal(motion.trajectory.pose.p[0], np.zeros(3))
    np.testing.assert_array_equal(motion.trajectory.pose.q[0], [0, 0, 0, 1])


@pytest.mark.parametrize("name", GENERATORS)
def test_a_motion_rests_for_two_seconds_at_both_ends_where_it_began(name):
    moving = generate(name).trajectory
    for part in (moving.between(0, 2 * NS), moving.between(moving.t[-1] - 2 * NS, moving.t[-1])):
        assert part.duration_s == 2.0
        assert np.abs(part.pose.p).max() < 1e-12
        assert relative_angle(part.pose.q, part.pose.q[:1]).max() < 1e-12
        assert relative_angle(part.pose.q, moving.pose.q[:1]).max() < 1e-12


@pytest.mark.parametrize("name", GENERATORS)
def test_a_motion_is_sampled_evenly_for_as_long_as_it_says(name):
    moving = generate(name).trajectory
    assert moving.duration_s == DURATION_S[name]
    assert np.abs(np.diff(moving.t) - NS / RATE_HZ).max() <= 1


def test_the_shooter_moves_as_the_paper_recorded():
    # speed 0.17 rms and 0.88 max m/s, 30 deg/s rms, a box of 0.64 x 0.20 x 0.31 m
    moving = generate("shooter-1").trajectory
    assert rms(moving.speed()) == pytest.approx(0.17, rel=0.1)
    assert moving.speed().max() == pytest.approx(0.88, rel=0.1)
    assert np.degrees(rms(moving.angular_speed())) == pytest.approx(30, rel=0.1)
    np.testing.assert_allclose(np.ptp(moving.pose.p, axis=0), [0.64, 0.20, 0.31], rtol=0.1)


@pytest.mark.parametrize("name", GENERATORS)
def test_nearly_all_power_lies_below_5_hz(name):
    moving = generate(name).trajectory
    velocity = np.diff(moving.pose.p, axis=0)
    power = np.sum(np.abs(np.fft.rfft(velocity, axis=0)) ** 2, axis=1)
    below = np.fft.rfftfreq(len(velocity), 1 / RATE_HZ) < 5.0
    assert power[below].sum() / power.sum() > 0.99


def test_the_calibration_reaches_beyond_the_shooter_along_every_axis():
    inner, outer = (generate(name).trajectory.pose.p for name in ("shooter-1", "saturate-1"))
    assert np.all(outer.min(axis=0) < inner.min(axis=0))
    assert np.all(outer.max(axis=0) > inner.max(axis=0))


def test_the_calibration_is_no_faster_than_the_shooter():
    slow, fast = (generate(name).trajectory for name in ("saturate-1", "shooter-1"))
    assert slow.speed().max() < 0.5 * fast.speed().max()
    assert slow.angular_speed().max() < fast.angular_speed().max()


def test_the_calibration_is_slow_at_the_flange_too():
    eye = generate("saturate-1").trajectory
    flange = Transform.of((0.003, 0.087, 0.276), (0.7071, 0.0, 0.0, 0.7071)).inverse()
    assert eye.mapped(lambda pose: pose @ flange).speed().max() < 0.5
    assert np.degrees(eye.angular_speed().max()) < 90.0


def test_an_unknown_name_lists_the_known():
    with pytest.raises(
        ConfigError, match=r"'shooter-9'.*there are saturate-1, saturate-30s-1, shooter-1"
    ):
        generate("shooter-9")


# motions in general


def motion_of(trajectory: Trajectory, name: str = "some-1", title: str = "Some") -> Motion:
    return Motion(name, title, trajectory, "made up")


def test_the_digest_is_of_name_and_values_not_of_title():
    moving = generate("saturate-30s-1").trajectory
    digest = motion_of(moving).digest
    assert motion_of(moving, title="Another").digest == digest
    assert motion_of(moving, name="other-1").digest != digest
    assert motion_of(moving[:-1]).digest != digest


def test_the_digest_is_blind_to_less_than_a_micrometre_and_sees_more():
    t, q = np.arange(3) * NS, np.tile([0.0, 0, 0, 1], (3, 1))
    p = np.zeros((3, 3))
    digest = motion_of(Trajectory(t, Transform(p, q))).digest
    assert motion_of(Trajectory(t, Transform(p + 1e-7, q))).digest == digest
    assert motion_of(Trajectory(t, Transform(p + 1e-5, q))).digest != digest


def test_motions_known_by_name_have_a_digest_each():
    assert digest_of_name("spt-dx-a") == digest_of_name("spt-dx-a")
    assert digest_of_name("spt-dx-a") != digest_of_name("spt-dx-b")


def test_at_twice_the_speed_it_takes_half_the_time():
    motion = generate("saturate-30s-1")
    assert at_speed(motion, 2.0).duration_s == 15.0
    np.testing.assert_array_equal(at_speed(motion, 1.0).t, motion.trajectory.t)


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_a_speed_is_positive(speed):
    with pytest.raises(ConfigError, match="speed"):
        at_speed(generate("saturate-30s-1"), speed)


def test_any_trajectory_can_be_told_from_its_first_pose():
    q = rotvec_to_quat(np.array([[0.3, 0.2, 0.1], [0.1, 0.5, 0.2]]))
    given = Trajectory(np.array([5, 9]) * NS, Transform(np.array([[1.0, 2, 3], [2, 3, 4]]), q))
    told = relative_to_first(given)
    assert told.t.tolist() == [0, 4 * NS]
    np.testing.assert_allclose((given.pose[0] @ told.pose).matrix(), given.pose.matrix())
