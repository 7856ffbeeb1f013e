"""Takes: what is written is read back exactly, by us and by readers that aren't ours."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vrbench.clocks import Exchanges
from vrbench.errors import DataError
from vrbench.geometry import Transform
from vrbench.recording.take import TakeWriter, read_take
from vrbench.streams import GOOD, Columns, Event, Joints, Samples

T0 = 1_706_706_051_123_456_789


def samples(n: int = 200, seed: int = 0, t0: int = T0, good: bool = False) -> Samples:
    rng = np.random.default_rng(seed)
    t = t0 + np.cumsum(rng.integers(1, 20_000_000, n))
    return Samples(
        source_t=t - 5,
        pose_t=t,
        receive_t=t + 7,
        pose=Transform.of(rng.normal(size=(n, 3)), rng.normal(size=(n, 4))),
        flags=np.full(n, GOOD, dtype=np.uint32)
        if good
        else rng.choice([GOOD, 3], n).astype(np.uint32),
        epoch=np.arange(n, dtype=np.uint32) // 100,
    )


def columns() -> Columns:
    rng = np.random.default_rng(1)
    t = T0 + np.arange(50) * 2_000_000
    names = ("shoulder_pan", "a", "elbow joint")
    return Columns(
        poses={"headset/eye": samples(), "robot/tcp": samples(seed=1), "mocap/b": samples(seed=2)},
        joints={
            "robot/joints": Joints(
                t, t + 1, rng.normal(size=(50, 3)), rng.normal(size=(50, 3)), names
            )
        },
        events=[Event(T0, "phase", {"name": "move"}), Event(T0 + 5, "note", {"n": 1, "x": "Ω"})],
        clocks={"optitrack": Exchanges(t, t + 3, t + 4, t + 9)},
        metadata={"case": "replay", "motion": "shooter-1"},
    )


def write(path: Path, content: Columns) -> Path:
    with TakeWriter(path, content.metadata) as writer:
        writer.write(content)
    return path


def assert_same(found: Samples, expected: Samples) -> None:
    for name in ("source_t", "pose_t", "receive_t", "flags", "epoch"):
        assert np.array_equal(getattr(found, name), getattr(expected, name)), name
    assert np.array_equal(found.pose.p, expected.pose.p)
    assert np.array_equal(found.pose.q, expected.pose.q)


def test_all_columns_come_back_exactly(tmp_path: Path) -> None:
    content = columns()
    found = read_take(write(tmp_path / "a.mcap", content))
    assert found.poses.keys() == content.poses.keys()
    for name, expected in content.poses.items():
        assert_same(found.poses[name], expected)
    joints, expected_joints = found.joints["robot/joints"], content.joints["robot/joints"]
    assert joints.names == expected_joints.names
    assert np.array_equal(joints.position, expected_joints.position)
    assert np.array_equal(joints.velocity, expected_joints.velocity)
    assert list(found.events) == list(content.events)
    assert np.array_equal(
        found.clocks["optitrack"].remote_sent, content.clocks["optitrack"].remote_sent
    )
    assert found.metadata == content.metadata


def test_joints_are_left_out_where_nobody_wants_them(tmp_path: Path) -> None:
    content = columns()
    path = write(tmp_path / "a.mcap", content)
    found = read_take(path, joints=False)
    assert found.joints == {} == found.states
    for name, expected in content.poses.items():
        assert_same(found.poses[name], expected)
    assert list(found.events) == list(content.events)
    assert found.clocks.keys() == content.clocks.keys()


def test_a_take_without_a_summary_is_read_all_the_same(tmp_path: Path) -> None:
    content = columns()
    whole = write(tmp_path / "a.mcap", content)
    part = whole.rename(tmp_path / "a.mcap.part")
    part.write_bytes(part.read_bytes()[:-40])
    found = read_take(part)
    for name, expected in content.poses.items():
        assert_same(found.poses[name], expected)
    assert found.joints.keys() == content.joints.keys()
    assert read_take(part, joints=False).joints == {}


@settings(max_examples=25, deadline=None)
@given(
    n=st.integers(0, 40),
    parts=st.integers(1, 5),
    names=st.lists(
        st.text("abcdefgh_", min_size=1, max_size=9), min_size=1, max_size=7, unique=True
    ),
    text=st.text(max_size=20).filter(lambda s: "\0" not in s),
)
def test_any_sizes_and_names_come_back(
    tmp_path_factory: pytest.TempPathFactory, n: int, parts: int, names: list[str], text: str
) -> None:
    path = tmp_path_factory.mktemp("take") / "a.mcap"
    rng = np.random.default_rng(n)
    whole = samples(n, seed=n)
    t = T0 + np.arange(n)
    joints = Joints(
        t, t, rng.normal(size=(n, len(names))), rng.normal(size=(n, len(names))), tuple(names)
    )
    with TakeWriter(path, {"note": text}) as writer:
        for k in range(parts):
            piece = slice(k * n // parts, (k + 1) * n // parts)
            writer.write(Columns({"headset/eye": whole[piece]}))
        writer.write(Columns({}, {"robot/joints": joints}, [Event(T0, "note", {"text": text})]))
    found = read_take(path)
    if n:
        assert_same(found.poses["headset/eye"], whole)
        assert found.joints["robot/joints"].names == tuple(names)
    assert found.events[0].detail == {"text": text}
    assert found.metadata == {"note": text}


def test_log_time_is_when_it_arrived_and_publish_time_when_it_was(tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    content = columns()
    with write(tmp_path / "a.mcap", content).open("rb") as file:
        found = [
            (message.log_time, message.publish_time)
            for _, _, message in reader.make_reader(file).iter_messages("/headset/eye/samples")
        ]
    expected = content.poses["headset/eye"]
    assert found == list(zip(expected.receive_t, expected.pose_t, strict=True))


def test_poses_are_the_valid_ones_and_samples_all(tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    content = columns()
    with write(tmp_path / "a.mcap", content).open("rb") as file:
        summary = reader.make_reader(file).get_summary()
    topics = {channel.topic: id_ for id_, channel in summary.channels.items()}
    counts = summary.statistics.channel_message_counts
    head = content.poses["headset/eye"]
    assert counts[topics["/headset/eye/samples"]] == len(head)
    assert counts[topics["/headset/eye/pose"]] == head.good.sum() < len(head)
    assert {"/robot/tcp", "/mocap/b/pose", "/robot/joints", "/events", "/clock/optitrack"} <= set(
        topics
    )


def test_rosbags_reads_every_message(tmp_path: Path) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    content = columns()
    path = write(tmp_path / "a.mcap", content)
    seen: dict[str, list[object]] = {}
    with highlevel.AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            seen.setdefault(connection.topic, []).append(
                reader.deserialize(raw, connection.msgtype)
            )
    head = content.poses["headset/eye"]
    first = seen["/headset/eye/samples"][0]
    assert first.source_time_ns == head.source_t[0]
    assert first.pose.orientation.w == head.pose.q[0, 3]
    good = head[head.good]
    stamps = [
        m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in seen["/headset/eye/pose"]
    ]
    assert stamps == good.pose_t.tolist()
    assert [m.pose.position.x for m in seen["/headset/eye/pose"]] == good.pose.p[:, 0].tolist()
    assert {m.header.frame_id for m in seen["/headset/eye/pose"]} == {"world"}
    joints = content.joints["robot/joints"]
    assert [tuple(m.name) for m in seen["/robot/joints"]] == [joints.names] * 50
    assert np.array_equal([m.velocity for m in seen["/robot/joints"]], joints.velocity)
    assert seen["/events"][1].kind == "note"
    assert seen["/clock/optitrack"][0].received_ns == content.clocks["optitrack"].received[0]


def test_the_ros_2_decoder_of_mcap_reads_every_message(tmp_path: Path) -> None:
    decoder = pytest.importorskip("mcap_ros2.reader")
    content = columns()
    path = write(tmp_path / "a.mcap", content)
    by_topic: dict[str, int] = {}
    for message in decoder.read_ros2_messages(str(path)):
        by_topic[message.channel.topic] = by_topic.get(message.channel.topic, 0) + 1
        if message.channel.topic == "/robot/joints":
            assert list(message.ros_msg.name) == list(content.joints["robot/joints"].names)
    assert by_topic["/headset/eye/samples"] == len(content.poses["headset/eye"])
    assert by_topic["/robot/joints"] == 50


@pytest.mark.filterwarnings("ignore")
def test_evo_opens_a_take(run: Path) -> None:
    pytest.importorskip("evo")
    take = run / "takes" / "replay.default.m1.r1.mcap"
    evo_ape = Path(sys.executable).with_name("evo_ape")
    done = subprocess.run(
        [str(evo_ape), "mcap", str(take), "/robot/tcp", "/headset/eye/pose", "-a"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "rmse" in done.stdout


def test_a_take_has_its_name_only_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with pytest.raises(RuntimeError, match="stop"), TakeWriter(path, {}) as writer:
        writer.write(columns())
        raise RuntimeError("stop")
    assert not path.exists()
    kept = read_take(path.with_name("a.mcap.part"))
    assert_same(kept.poses["headset/eye"], columns().poses["headset/eye"])


def test_a_take_is_never_written_over(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", columns())
    with pytest.raises(DataError, match="already there"), TakeWriter(path, {}):
        pass


@pytest.mark.parametrize("damage", ["empty", "text", "half", "flipped"])
def test_what_is_no_whole_take_is_refused(tmp_path: Path, damage: str) -> None:
    path = write(tmp_path / "a.mcap", columns())
    raw = bytearray(path.read_bytes())
    if damage == "empty":
        raw = bytearray()
    elif damage == "text":
        raw = bytearray(b"t x y z\n1 2 3 4\n")
    elif damage == "half":
        raw = raw[: len(raw) // 2]
    else:
        for at in range(len(raw) // 4, len(raw) // 2):
            raw[at] ^= 0xFF
    path.write_bytes(raw)
    with pytest.raises(DataError, match="not a whole MCAP file") as caught:
        read_take(path)
    assert str(path) in str(caught.value)


def test_a_missing_take_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such take"):
        read_take(tmp_path / "b.mcap")


def test_a_take_by_others_needs_only_poses(tmp_path: Path) -> None:
    """PoseStamped without samples, as another writer makes it: header stamps are pose times."""
    writer_module = pytest.importorskip("mcap_ros2.writer")
    from vrbench.recording import cdr

    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = writer_module.Writer(file)
        schema = writer.register_msgdef(cdr.POSE_STAMPED, cdr.SCHEMAS[cdr.POSE_STAMPED])
        for k in range(3):
            pose = {"position": {"x": k, "y": 1.0, "z": 2.0}, "orientation": {"w": 1.0}}
            header = {"stamp": {"sec": 100 + k, "nanosec": 5}, "frame_id": "map"}
            writer.write_message(
                "/robot/tcp", schema, {"header": header, "pose": pose}, log_time=k, publish_time=k
            )
        writer.finish()
    found = read_take(path).poses["robot/tcp"]
    assert found.pose_t.tolist() == [100_000_000_005, 101_000_000_005, 102_000_000_005]
    assert found.pose.p[:, 0].tolist() == [0.0, 1.0, 2.0]
