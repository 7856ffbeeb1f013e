"""Bags are made by the library that also reads them, and decoded by vrbench's own code."""

from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from vrbench.errors import DataError
from vrbench.geometry import ROS, quat_normalize, relative_angle
from vrbench.recording.bags import LAYOUTS, BagOptions
from vrbench.recording.importers import builtin_importers, rosbag1, rosbag2

POSE = "geometry_msgs/msg/PoseStamped"
START = 1_706_706_034_000_000_000
RNG = np.random.default_rng(1)
P, Q = RNG.normal(size=(20, 3)), quat_normalize(RNG.normal(size=(20, 4)))
Q *= np.where(np.cumprod(np.r_[1, np.sign(np.sum(Q[1:] * Q[:-1], axis=1))]) < 0, -1, 1)[:, None]
T = START + np.arange(20) * 33_333_333


class Ros1:
    importer = rosbag1.IMPORTER
    store = get_typestore(Stores.ROS1_NOETIC)

    def write(self, folder, messages):
        path = folder / "made.bag"
        with Writer1(path) as bag:
            connections = {}
            for topic, kind, received, message in messages:
                if topic not in connections:
                    connections[topic] = bag.add_connection(topic, kind, typestore=self.store)
                raw = self.store.serialize_ros1(message, kind)
                bag.write(connections[topic], int(received), raw)
        return path

    def header(self, t, frame):
        time = self.store.types["builtin_interfaces/msg/Time"](int(t // 10**9), int(t % 10**9))
        return self.store.types["std_msgs/msg/Header"](seq=0, stamp=time, frame_id=frame)


class Ros2(Ros1):
    importer = rosbag2.IMPORTER
    store = get_typestore(Stores.ROS2_HUMBLE)
    storage = StoragePlugin.SQLITE3

    def write(self, folder, messages):
        path = folder / "made"
        with Writer2(path, version=9, storage_plugin=self.storage) as bag:
            connections = {}
            for topic, kind, received, message in messages:
                if topic not in connections:
                    connections[topic] = bag.add_connection(topic, kind, typestore=self.store)
                raw = self.store.serialize_cdr(message, kind)
                bag.write(connections[topic], int(received), raw)
        return path

    def header(self, t, frame):
        time = self.store.types["builtin_interfaces/msg/Time"](int(t // 10**9), int(t % 10**9))
        return self.store.types["std_msgs/msg/Header"](stamp=time, frame_id=frame)


class Mcap(Ros2):
    storage = StoragePlugin.MCAP


@pytest.fixture(params=[Ros1, Ros2, Mcap])
def ros(request):
    return request.param()


def message(ros, kind, t, p, q, frame="base", child="tool0"):
    """A message of any of the types that can be read."""
    types = SimpleNamespace(
        **{k.rpartition("/")[2]: v for k, v in ros.store.types.items() if "geometry_msgs" in k}
    )
    header = ros.header(t, frame)
    pose = types.Pose(position=types.Point(*p), orientation=types.Quaternion(*q))
    covariance = np.full(36, 7.0)
    cls = ros.store.types[kind]
    match kind.rpartition("/")[2]:
        case "PoseStamped":
            return cls(header=header, pose=pose)
        case "PoseWithCovarianceStamped":
            return cls(header, types.PoseWithCovariance(pose=pose, covariance=covariance))
        case "TransformStamped":
            transform = types.Transform(types.Vector3(*p), types.Quaternion(*q))
            return cls(header=header, child_frame_id=child, transform=transform)
        case _:
            twist = types.Twist(types.Vector3(9.0, 9.0, 9.0), types.Vector3(9.0, 9.0, 9.0))
            return cls(
                header,
                child,
                types.PoseWithCovariance(pose=pose, covariance=covariance),
                types.TwistWithCovariance(twist=twist, covariance=covariance),
            )


def rows(ros, kind=POSE, topic="/tcp", t=T, frames=("base",), p=P, q=Q, delay=140_000):
    return [
        (topic, kind, START + i * 33_333_333 + delay, message(ros, kind, t[i], p[i], q[i], frame))
        for i, frame in zip(range(len(t)), list(frames) * len(t), strict=False)
    ]


def read(ros, path, topic="/tcp"):
    return ros.importer.read(path, BagOptions(topic=topic))


@pytest.mark.parametrize("frame", ["", "base", "a", "ab", "abc", "longer/frame"])
@pytest.mark.parametrize("kind", LAYOUTS)
def test_every_type_that_can_be_read_gives_its_stamps_and_poses(tmp_path, ros, kind, frame):
    path = ros.write(tmp_path, rows(ros, kind, frames=(frame,)))
    imported = read(ros, path)
    np.testing.assert_array_equal(imported.samples.source_t, T)
    np.testing.assert_array_equal(imported.samples.pose_t, T)
    np.testing.assert_array_equal(imported.samples.receive_t, T + 140_000)
    np.testing.assert_array_equal(imported.samples.pose.p, P)
    np.testing.assert_allclose(imported.samples.pose.q, Q, atol=1e-15)
    assert imported.repairs == ()


def test_poses_of_a_headset_in_axes_of_ros_become_openxrs(tmp_path, ros):
    path = ros.write(tmp_path, rows(ros))
    pose = ros.importer.read(path, BagOptions(topic="/tcp", axes="ros")).samples.pose
    back = ROS.from_openxr(pose)
    np.testing.assert_allclose(back.p, P, atol=1e-15)
    assert relative_angle(back.q, Q).max() < 1e-12


def test_a_mcap_file_is_read_without_its_folder(tmp_path):
    path = Mcap().write(tmp_path, rows(Mcap()))
    assert len(read(Mcap(), path / "made.mcap").samples) == 20


def test_flips_of_sign_are_undone(tmp_path, ros):
    path = ros.write(tmp_path, rows(ros, q=Q * RNG.choice([-1, 1], size=(20, 1))))
    q = read(ros, path).samples.pose.q
    assert np.all(np.sum(q[1:] * q[:-1], axis=1) > 0)


def test_a_message_logged_twice_is_dropped_and_recorded(tmp_path, ros):
    t = T.copy()
    t[7] = t[6]
    imported = read(ros, ros.write(tmp_path, rows(ros, t=t)))
    assert len(imported.samples) == 19
    assert imported.repairs == (
        "1 message dropped, whose stamps repeat or go back (first: message 8)",
    )


def test_stamps_that_go_back_more_often_are_refused(tmp_path, ros):
    with pytest.raises(DataError, match="go back or repeat at 1 of 20 places, first at message 11"):
        read(ros, ros.write(tmp_path, rows(ros, t=np.r_[T[:10], T[:10]])))


def test_without_header_stamps_the_bag_time_stands_in_and_it_is_said(tmp_path, ros):
    imported = read(ros, ros.write(tmp_path, rows(ros, t=T * 0)))
    np.testing.assert_array_equal(imported.samples.pose_t, T + 140_000)
    assert imported.repairs[0].startswith("the headers carry no stamps")


def test_a_wrong_topic_names_those_that_hold_poses(tmp_path, ros):
    text = ros.store.types["std_msgs/msg/String"](data="hello")
    path = ros.write(
        tmp_path, [*rows(ros, topic="/a"), ("/chat", "std_msgs/msg/String", START, text)]
    )
    with pytest.raises(DataError) as caught:
        read(ros, path, "/b")
    assert caught.value.field == "/b"
    assert "topics with poses: /a (geometry_msgs/msg/PoseStamped)" in str(caught.value)
    assert "/chat" not in str(caught.value)


def test_a_topic_of_another_type_says_which_can_be_read(tmp_path, ros):
    text = ros.store.types["std_msgs/msg/String"](data="hello")
    path = ros.write(tmp_path, [("/chat", "std_msgs/msg/String", START, text)])
    with pytest.raises(DataError, match=r"/chat: the topic holds std_msgs/msg/String.*Odometry"):
        read(ros, path, "/chat")
    with pytest.raises(DataError, match=r"no topic has poses; there are: /chat \(std_msgs"):
        read(ros, path, "/tcp")


def test_poses_in_several_frames_are_refused(tmp_path, ros):
    path = ros.write(tmp_path, rows(ros, frames=("map", "odom")))
    with pytest.raises(DataError, match="poses are given in 2 frames: map, odom"):
        read(ros, path)


def test_values_that_are_not_finite_are_refused(tmp_path, ros):
    p = P.copy()
    p[4, 2] = np.nan
    with pytest.raises(DataError, match="position of message 5 is not finite"):
        read(ros, ros.write(tmp_path, rows(ros, p=p)))


def test_a_topic_without_messages_is_refused(tmp_path):
    path = tmp_path / "empty.bag"
    with Writer1(path) as bag:
        bag.add_connection("/tcp", POSE, typestore=Ros1.store)
        other = bag.add_connection("/chat", "std_msgs/msg/String", typestore=Ros1.store)
        bag.write(other, START, b"\0\0\0\0")
    with pytest.raises(DataError, match=r"/tcp: the topic has no messages"):
        read(Ros1(), path)


def test_a_bag_without_anything_in_it_is_refused(tmp_path):
    path = tmp_path / "empty.bag"
    with Writer1(path):
        pass
    with pytest.raises(DataError, match=r"no such topic .*there are: none"):
        read(Ros1(), path)


def test_a_message_that_is_too_short_is_named(tmp_path):
    path = tmp_path / "short.bag"
    with Writer1(path) as bag:
        tcp = bag.add_connection("/tcp", POSE, typestore=Ros1.store)
        bag.write(tcp, START, bytes(72))
        bag.write(tcp, START + 1, bytes(40))
    with pytest.raises(DataError, match="message 2 is damaged or of another layout"):
        read(Ros1(), path)


@pytest.mark.parametrize("part", [0.02, 0.3, 0.5, 0.9, 0.99])
def test_a_bag_cut_short_gives_one_error_with_what_to_do(tmp_path, part):
    path = Ros1().write(tmp_path, rows(Ros1()))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * part)])
    with pytest.raises(DataError, match=r"made\.bag: can't be read as a ROS 1 bag.*reindex"):
        read(Ros1(), path)


@pytest.mark.parametrize("importer", [rosbag1.IMPORTER, rosbag2.IMPORTER], ids=lambda x: x.name)
@pytest.mark.parametrize("content", [b"", b"t,x,y,z\n", b"\x89\xff\x00", bytes(5000)])
@pytest.mark.parametrize("name", ["file.bag", "file.mcap", "file.db3", "file.txt"])
def test_a_file_that_is_no_bag_gives_one_error(tmp_path, importer, content, name):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(DataError, match=rf"{name}: can't be read as a ROS . bag"):
        importer.read(path, BagOptions(topic="/tcp"))


def test_a_missing_file_and_a_folder_are_refused(tmp_path, ros):
    with pytest.raises(DataError, match=r"none\.bag: no such file"):
        read(ros, tmp_path / "none.bag")
    with pytest.raises(DataError, match="can't be read as a ROS"):
        read(ros, tmp_path)


def test_the_built_in_importers_are_found_by_name():
    assert [x.name for x in builtin_importers()] == [
        "c3d",
        "csv",
        "duke",
        "euroc",
        "rosbag1",
        "rosbag2",
        "tum",
    ]
