import numpy as np
import pytest

from vrbench.geometry import Transform
from vrbench.streams import GOOD, Flag, Samples

EPOCH = 1_700_000_000_123_456_789


def samples(t, *, x=None, flags=GOOD) -> Samples:
    """Samples at t, with x (the arrival's number, where it isn't given) as position."""
    t = np.asarray(t, dtype=np.int64)
    p = np.zeros((len(t), 3))
    p[:, 0] = np.arange(len(t)) if x is None else x
    made = Samples.of(t, Transform(p, np.tile([0.0, 0, 0, 1], (len(t), 1))))
    return Samples(
        made.source_t,
        made.pose_t,
        made.receive_t,
        made.pose,
        np.broadcast_to(np.asarray(flags, dtype=np.uint32), len(t)),
        made.epoch,
    )


def test_the_trajectory_is_sorted_by_pose_time():
    found = samples([EPOCH + 2, EPOCH, EPOCH + 1]).trajectory()
    assert found.t.tolist() == [EPOCH, EPOCH + 1, EPOCH + 2]
    assert found.pose.p[:, 0].tolist() == [1, 2, 0]


def test_of_poses_with_one_time_the_first_to_arrive_is_kept():
    found = samples([30, 10, 10, 20, 30, 10]).trajectory()
    assert found.t.tolist() == [10, 20, 30]
    assert found.pose.p[:, 0].tolist() == [1, 3, 0]


def test_of_poses_with_one_time_a_bad_one_makes_way_for_a_good_one():
    found = samples([10, 10], flags=[0, GOOD]).trajectory()
    assert found.pose.p[:, 0].tolist() == [1]


@pytest.mark.parametrize("lacking", list(Flag))
def test_a_pose_that_lacks_any_flag_is_left_out(lacking):
    found = samples([10, 20, 30], flags=[GOOD, GOOD & ~lacking, GOOD])
    assert found.good.tolist() == [True, False, True]
    assert found.trajectory().t.tolist() == [10, 30]


def test_flags_of_runtimes_to_come_do_no_harm():
    assert samples([10], flags=GOOD | 1 << 20).good.all()


def test_without_a_good_pose_the_trajectory_is_empty():
    assert len(samples([10, 20], flags=0).trajectory()) == 0
    assert len(samples([]).trajectory()) == 0


def test_signs_are_continuous_in_time_not_in_arrival():
    q = np.array([[0.0, 0, 0, 1], [0, 0, 0, -1], [0, 0, 0, 1]])
    found = Samples.of(np.array([10, 30, 20]), Transform(np.zeros((3, 3)), q)).trajectory()
    assert np.unique(found.pose.q[:, 3]).size == 1


def test_joined_samples_are_in_order_of_arrival_in_every_column():
    first, second = samples([30, 40], x=[1, 2], flags=[GOOD, 0]), samples([10], x=[3])
    joined = Samples.concatenate([first, second])
    assert joined.pose_t.tolist() == [30, 40, 10]
    assert joined.pose.p[:, 0].tolist() == [1, 2, 3]
    assert joined.flags.tolist() == [GOOD, 0, GOOD]
    assert len(joined) == 3
    assert joined[1:].pose_t.tolist() == [40, 10]


def test_a_source_of_one_stamp_has_arrived_when_it_says_unless_told():
    t = np.array([10, 20])
    pose = samples(t).pose
    assert Samples.of(t, pose).receive_t.tolist() == [10, 20]
    assert Samples.of(t, pose, receive_t=t + 5).receive_t.tolist() == [15, 25]
