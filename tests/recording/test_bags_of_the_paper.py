"""The bag importer on the paper's own bags, against what was measured on them."""

import numpy as np
import pytest

from vrbench.errors import DataError, VrbenchError
from vrbench.recording.bags import BagOptions
from vrbench.recording.datasets import State, find, known, status
from vrbench.recording.importers.rosbag1 import IMPORTER

NAME = "banaszczyk2024"
TCP = "/my_ur5e/endeffpos"
HEAD = "/optitrack_node/rigid_body_0"
# Messages, flips of sign in the raw quaternions, first header stamp.
BAGS = {
    "quest2/tcp_bags/calib.bag": (7653, 8, 1706706034330367565),
    "quest2/tcp_bags/traj1.bag": (4731, 24, 1706706408530328512),
    "quest_pro/tcp_bags/calib.bag": (7405, 8, 1706708959563651323),
    "quest_pro/tcp_bags/traj1.bag": (4441, 24, 1706709283230362415),
}


def path_of(path):
    try:
        folder = find(NAME)
    except VrbenchError:
        pytest.skip(f"dataset {NAME} is not here: {known(NAME).how_to_get}")
    state = next(x.state for x in status(NAME) if x.path == path)
    if state is not State.PRESENT:
        pytest.skip(f"{path} of {NAME} is {state}")
    return folder / path


@pytest.fixture(params=BAGS)
def bag(request):
    return path_of(f"data/experiments/{request.param}"), BAGS[request.param]


def raw_quaternions(path):
    """As the library's own deserialiser reads them."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        chosen = [x for x in reader.connections if x.topic == TCP]
        poses = [reader.deserialize(raw, x.msgtype).pose for x, _, raw in reader.messages(chosen)]
    q = [(p.orientation.x, p.orientation.y, p.orientation.z, p.orientation.w) for p in poses]
    return np.array([(p.position.x, p.position.y, p.position.z) for p in poses]), np.array(q)


def test_the_robot_is_logged_at_30_hz_and_every_message_is_a_pose(bag):
    path, (messages, _, start) = bag
    imported = IMPORTER.read(path, BagOptions(topic=TCP))
    t = imported.samples.pose_t
    assert len(t) == messages
    assert imported.repairs == ()
    assert np.all(np.diff(t) > 0)
    assert 1e9 * (len(t) - 1) / (t[-1] - t[0]) == pytest.approx(30.0, abs=1e-3)
    assert t[0] == start


def test_bag_time_follows_header_stamp_by_a_tenth_of_a_millisecond(bag):
    samples = IMPORTER.read(bag[0], BagOptions(topic=TCP)).samples
    delay_ms = (samples.receive_t - samples.pose_t) / 1e6
    assert np.median(delay_ms) == pytest.approx(0.14, abs=0.01)
    assert delay_ms.min() > 0


def test_poses_are_those_the_library_reads_but_for_flips_of_sign(bag):
    path, (_, flips, _) = bag
    pose = IMPORTER.read(path, BagOptions(topic=TCP)).samples.pose
    p, q = raw_quaternions(path)
    assert np.count_nonzero(np.sum(q[1:] * q[:-1], axis=1) < 0) == flips
    np.testing.assert_array_equal(pose.p, p)
    np.testing.assert_allclose(np.abs(np.sum(pose.q * q, axis=1)), 1.0, atol=1e-12)
    assert np.all(np.sum(pose.q[1:] * pose.q[:-1], axis=1) > 0.9)


def test_head_motion_is_read_beside_a_message_type_of_its_own():
    path = path_of("data/real_world_head_trajectories/real_world_head_movement_example_0.bag")
    samples = IMPORTER.read(path, BagOptions(topic=HEAD)).samples
    assert len(samples) == 13479
    assert 1e9 / np.diff(samples.pose_t).mean() == pytest.approx(120.0, abs=1e-3)
    steps = np.linalg.norm(np.diff(samples.pose.p, axis=0), axis=1)
    assert steps.sum() == pytest.approx(12.5, abs=0.1)
    with pytest.raises(DataError, match=r"rigid_body_debug_0: the topic holds optitrack/msg/Rigid"):
        IMPORTER.read(path, BagOptions(topic="/optitrack_node/rigid_body_debug_0"))


def test_a_wrong_topic_of_the_papers_bag_says_which_there_is(bag):
    with pytest.raises(DataError, match=rf"/tcp: no such topic \(topics with poses: {TCP} "):
        IMPORTER.read(bag[0], BagOptions(topic="/tcp"))
