import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from vrbench.errors import DataError
from vrbench.geometry import Transform, relative_angle, rotvec_to_quat
from vrbench.trajectory import NS, Trajectory, distinct, read_tum, seconds_since, write_tum

EPOCH = 1_700_000_000_123_456_789


def trajectory(t, seed: int = 0) -> Trajectory:
    rng = np.random.default_rng(seed)
    t = np.asarray(t, dtype=np.int64)
    steps = rng.normal(0, 0.2, (len(t), 6))
    course = np.cumsum(steps, axis=0)
    return Trajectory(t, Transform(course[:, :3], rotvec_to_quat(course[:, 3:])))


def times(n: int = 50, seed: int = 0) -> np.ndarray:
    return EPOCH + np.cumsum(np.random.default_rng(seed).integers(1, 20_000_000, n))


@pytest.mark.parametrize("t", [[0, 0], [1, 0], [EPOCH, EPOCH + 1, EPOCH + 1]])
def test_stamps_must_increase(t):
    with pytest.raises(ValueError, match="increase strictly"):
        trajectory(t)


def test_there_is_a_stamp_for_each_pose():
    with pytest.raises(ValueError, match="3 stamps for 2 poses"):
        Trajectory(np.arange(3), trajectory([0, 1]).pose)


# time, to the nanosecond


def test_neighbouring_nanoseconds_of_epoch_time_stay_apart():
    t = EPOCH + np.arange(5)
    np.testing.assert_array_equal(seconds_since(t, EPOCH), np.arange(5) / NS)
    found = trajectory(t).between(EPOCH + 1, EPOCH + 3)
    np.testing.assert_array_equal(found.t, t[1:4])


def test_interpolation_is_exact_to_the_nanosecond_at_epoch_time():
    pose = Transform(np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.tile([0.0, 0, 0, 1], (2, 1)))
    moving = Trajectory(np.array([EPOCH, EPOCH + NS]), pose)
    t = EPOCH + np.array([1, 2, 999_999_999])
    np.testing.assert_array_equal(moving.at(t).p[:, 0], [1e-9, 2e-9, 0.999999999])


def test_duration_and_period_are_of_the_stamps():
    moving = trajectory(EPOCH + np.array([0, 10, 20, 40]) * 1_000_000)
    assert moving.duration_s == 0.04
    assert moving.period_s == 0.01
    assert moving[:0].duration_s == 0.0


def test_the_part_between_two_times_takes_in_both():
    moving = trajectory([0, 10, 20, 30])
    assert moving.between(10, 20).t.tolist() == [10, 20]
    assert moving.between(11, 19).t.tolist() == []
    assert moving.between(-5, 99).t.tolist() == [0, 10, 20, 30]


# interpolation


def test_interpolated_rotations_are_scipys():
    t = times()
    moving = trajectory(t)
    at = np.sort(np.random.default_rng(1).integers(t[0], t[-1], 200))
    expected = Slerp(t - t[0], Rotation.from_quat(moving.pose.q))(at - t[0]).as_quat()
    assert relative_angle(moving.at(at).q, expected).max() < 1e-7
    for axis in range(3):
        linear = np.interp(at - t[0], t - t[0], moving.pose.p[:, axis])
        np.testing.assert_allclose(moving.at(at).p[:, axis], linear, atol=1e-12)


def test_at_its_own_stamps_a_trajectory_is_itself():
    moving = trajectory(times())
    found = moving.at(moving.t)
    np.testing.assert_allclose(found.p, moving.pose.p, atol=1e-15)
    assert relative_angle(found.q, moving.pose.q).max() < 1e-12


def test_a_trajectory_of_one_pose_is_at_that_pose():
    moving = trajectory([EPOCH])
    np.testing.assert_array_equal(moving.at(np.array([EPOCH])).p, moving.pose.p)
    assert not moving.covers(np.array([EPOCH]), NS).any()


def test_times_are_covered_within_and_not_across_wide_gaps():
    moving = trajectory([0, 10, 20, 60, 70])
    asked = np.array([-1, 0, 5, 20, 40, 60, 70, 71])
    assert moving.covers(asked, 10).tolist() == [
        False, True, True, False, False, True, True, False,
    ]  # fmt: skip
    assert moving.covers(asked, 40).tolist() == [False, *[True] * 6, False]


def test_speeds_are_steps_over_times():
    p = np.array([[0.0, 0, 0], [3, 4, 0], [3, 4, 1]])
    q = rotvec_to_quat(np.array([[0.0, 0, 0], [0, 1, 0], [0, 1.5, 0]]))
    moving = Trajectory(np.array([0, NS // 2, NS]), Transform(p, q))
    np.testing.assert_allclose(moving.speed(), [10, 2])
    np.testing.assert_allclose(moving.angular_speed(), [2, 1])


def test_mapped_keeps_the_stamps():
    moving = trajectory(times())
    shift = Transform.of([1, 0, 0], [0, 0, 0, 1])
    moved = moving.mapped(lambda pose: shift @ pose)
    assert moved.t is moving.t
    np.testing.assert_allclose(moved.pose.p - moving.pose.p, np.tile([1, 0, 0], (50, 1)))


# TUM text


@settings(max_examples=30, deadline=None)
@given(
    start=st.sampled_from([0, -EPOCH, -1, 999_999_999, 10**15 - 3, EPOCH, 2**62]),
    steps=st.lists(st.integers(1, 10**10), min_size=1, max_size=20),
)
def test_what_is_written_is_read_back_to_the_nanosecond(tmp_path_factory, start, steps):
    path = tmp_path_factory.mktemp("tum") / "head.tum"
    written = trajectory(start + np.cumsum(steps))
    write_tum(written, path)
    read = read_tum(path)
    np.testing.assert_array_equal(read.t, written.t)
    np.testing.assert_array_equal(read.pose.p, written.pose.p)
    np.testing.assert_allclose(read.pose.q, written.pose.q, atol=1e-15)


def test_stamps_may_be_written_as_numpy_and_others_write_them(tmp_path):
    path = tmp_path / "head.tum"
    path.write_text(
        "# time x y z qx qy qz qw\n"
        "1.700000000123456789e+09 0 0 0 0 0 0 1\n"
        "\n"
        "1700000001 0 0 0 0 0 0 1  # a remark\n"
        "1700000001.5 0 0 0 0 0 0 1\n"
    )
    expected = [EPOCH, 1_700_000_001 * NS, 1_700_000_001 * NS + NS // 2]
    assert read_tum(path).t.tolist() == expected


def test_signs_are_made_continuous_and_lengths_one(tmp_path):
    path = tmp_path / "head.tum"
    path.write_text("0 0 0 0 0 0 0 1.001\n1 0 0 0 0 0 0 -1\n")
    np.testing.assert_array_equal(read_tum(path).pose.q, [[0, 0, 0, 1]] * 2)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "holds no poses"),
        ("0 1 2 3 0 0 0\n", "rows have 7 columns .*8"),
        ("0 1 2 3 0 0 0 1 9\n", "rows have 9 columns .*8"),
        ("0,1,2,3,0,0,0,1\n", "is not TUM text"),
        ("0 1 2 3 0 0 0 1\n1 1 2 3\n", "is not TUM text .*t x y z"),
        ("nan 1 2 3 0 0 0 1\n", "stamp of pose 1"),
        ("1e300 1 2 3 0 0 0 1\n", "stamp of pose 1"),
        ("0 inf 2 3 0 0 0 1\n", "position of pose 1 is not finite"),
        ("0 1 2 3 0 0 0 1\n1 1 2 3 0 0 nan 1\n", "quaternion of pose 2 is not finite"),
        ("0 1 2 3 0 0 0 0\n", "quaternion of pose 1 has length 0 .*x y z w"),
        ("0 1 2 3 0 0 0 1\n0 1 2 3 0 0 0 1\n", "do not increase at pose 2 .*sort"),
    ],
)
def test_bad_text_is_one_error_with_the_file_in_it(tmp_path, text, says):
    path = tmp_path / "head.tum"
    path.write_text(text)
    with pytest.raises(DataError, match=rf"head\.tum: .*{says}"):
        read_tum(path)


def test_a_missing_file_and_a_folder_can_not_be_read(tmp_path):
    for path in (tmp_path / "none.tum", tmp_path):
        with pytest.raises(DataError, match="can't be read"):
            read_tum(path)


@pytest.mark.parametrize("n", [0, 1, 2, 1000])
def test_distinct_stamps_are_in_order_and_each_is_there_once(n):
    t = np.random.default_rng(n).integers(0, 500, n)
    assert distinct(t).tolist() == sorted(set(t.tolist()))
