"""The messages of a take: ROS 2 schemas, and their CDR bytes to and from columns of numpy.

All messages of one topic have one size, so a whole column is encoded or decoded by one numpy
structured array. Layout: OMG CDR, little-endian; alignment counts from behind the 4-byte header.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

from vrbench.clocks import Exchanges
from vrbench.geometry import Ints, Transform
from vrbench.recording.messages import Messages
from vrbench.streams import Event, Joints, Samples, States
from vrbench.trajectory import NS

HEADER = b"\x00\x01\x00\x00"

_TIME = "int32 sec\nuint32 nanosec\n"
_HEADER_MSG = "builtin_interfaces/Time stamp\nstring frame_id\n"
_POINT = "float64 x\nfloat64 y\nfloat64 z\n"
_QUATERNION = "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
_POSE = "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"


def _schema(body: str, **parts: str) -> str:
    """ros2msg text: a definition and, behind lines of `=`, those it is made of."""
    names = {
        "time": "builtin_interfaces/Time",
        "header": "std_msgs/Header",
        "point": "geometry_msgs/Point",
        "quaternion": "geometry_msgs/Quaternion",
        "pose": "geometry_msgs/Pose",
    }
    return body + "".join(f"{'=' * 80}\nMSG: {names[k]}\n{text}" for k, text in parts.items())


POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
JOINT_STATE = "sensor_msgs/msg/JointState"
SAMPLE = "vrbench_msgs/msg/Sample"
EVENT = "vrbench_msgs/msg/Event"
CLOCK_EXCHANGE = "vrbench_msgs/msg/ClockExchange"
ROBOT_STATE = "vrbench_msgs/msg/RobotState"

SCHEMAS = {
    POSE_STAMPED: _schema(
        "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
        header=_HEADER_MSG,
        time=_TIME,
        pose=_POSE,
        point=_POINT,
        quaternion=_QUATERNION,
    ),
    JOINT_STATE: _schema(
        "std_msgs/Header header\nstring[] name\n"
        "float64[] position\nfloat64[] velocity\nfloat64[] effort\n",
        header=_HEADER_MSG,
        time=_TIME,
    ),
    SAMPLE: _schema(
        "int64 source_time_ns\nint64 pose_time_ns\nint64 receive_time_ns\n"
        "geometry_msgs/Pose pose\nuint32 flags\nuint32 epoch\n",
        pose=_POSE,
        point=_POINT,
        quaternion=_QUATERNION,
    ),
    CLOCK_EXCHANGE: "int64 sent_ns\nint64 remote_received_ns\nint64 remote_sent_ns\n"
    "int64 received_ns\n",
    ROBOT_STATE: "int64 stamp_ns\nint64 receive_time_ns\nint64 device_time_ns\n"
    "float64 speed_scaling\nuint32 safety\nuint32 runtime\n",
    EVENT: _schema("builtin_interfaces/Time stamp\nstring kind\nstring detail\n", time=_TIME),
}

_SAMPLE_LAYOUT = np.dtype(
    [
        ("header", "V4"),
        ("source", "<i8"),
        ("pose_t", "<i8"),
        ("receive", "<i8"),
        ("p", "<f8", 3),
        ("q", "<f8", 4),
        ("flags", "<u4"),
        ("epoch", "<u4"),
    ]
)
_STATE_LAYOUT = np.dtype(
    [
        ("header", "V4"),
        ("t", "<i8"),
        ("receive", "<i8"),
        ("device", "<i8"),
        ("speed_scaling", "<f8"),
        ("safety", "<u4"),
        ("runtime", "<u4"),
    ]
)
_EXCHANGE_LAYOUT = np.dtype([("header", "V4"), ("stamps", "<i8", 4)])


def _string(text: str) -> bytes:
    raw = text.encode() + b"\0"
    return struct.pack("<I", len(raw)) + raw


def _padded(raw: bytes, size: int, at: int) -> bytes:
    """The bytes, and zeros up to where the next multiple of `size` from `at` lies."""
    return raw + b"\0" * (-(at + len(raw)) % size)


def _stamps(rows: Any, t: Ints) -> None:
    rows["sec"], rows["nanosec"] = t // NS, t % NS


def _pose_layout(frame: bytes) -> np.dtype[Any]:
    return np.dtype(
        [
            ("header", "V4"),
            ("sec", "<i4"),
            ("nanosec", "<u4"),
            ("frame", f"V{len(frame)}"),
            ("p", "<f8", 3),
            ("q", "<f8", 4),
        ]
    )


def _rows(raw: bytes | np.ndarray[Any, Any], layout: np.dtype[Any]) -> list[bytes]:
    size = layout.itemsize
    whole = bytes(raw)
    return [whole[i : i + size] for i in range(0, len(whole), size)]


def encode_poses(t: Ints, pose: Transform, frame_id: str) -> list[bytes]:
    """PoseStamped messages of poses (n,) with header stamps t (n,) [ns]."""
    frame = _padded(_string(frame_id), 8, 8)
    layout = _pose_layout(frame)
    rows = np.zeros(len(t), dtype=layout)
    rows["header"], rows["frame"] = np.void(HEADER), np.void(frame)
    _stamps(rows, t)
    rows["p"], rows["q"] = pose.p, pose.q
    return _rows(rows.tobytes(), layout)


def decode_poses(messages: Messages) -> Samples:
    """Samples of PoseStamped messages; all have one frame_id."""
    (length,) = struct.unpack_from("<I", messages.first, 12)
    frame = _padded(b"\0" * (4 + length), 8, 8)
    rows = messages.rows(_pose_layout(frame))
    t = rows["sec"].astype(np.int64) * NS + rows["nanosec"]
    pose = Transform(rows["p"], rows["q"])
    return Samples.of(t, pose, receive_t=messages.log_t)


def encode_samples(samples: Samples) -> list[bytes]:
    """`vrbench_msgs/msg/Sample` messages."""
    rows = np.zeros(len(samples), dtype=_SAMPLE_LAYOUT)
    rows["header"] = np.void(HEADER)
    rows["source"], rows["pose_t"] = samples.source_t, samples.pose_t
    rows["receive"] = samples.receive_t
    rows["p"], rows["q"] = samples.pose.p, samples.pose.q
    rows["flags"], rows["epoch"] = samples.flags, samples.epoch
    return _rows(rows.tobytes(), _SAMPLE_LAYOUT)


def decode_samples(messages: Messages) -> Samples:
    """The samples of `vrbench_msgs/msg/Sample` messages."""
    rows = messages.rows(_SAMPLE_LAYOUT)
    return Samples(
        source_t=rows["source"],
        pose_t=rows["pose_t"],
        receive_t=rows["receive"],
        pose=Transform(rows["p"], rows["q"]),
        flags=rows["flags"],
        epoch=rows["epoch"],
    )


def _joint_layout(names: bytes, k: int) -> np.dtype[Any]:
    return np.dtype(
        [
            ("header", "V4"),
            ("sec", "<i4"),
            ("nanosec", "<u4"),
            ("names", f"V{len(names)}"),
            ("position", "<f8", k),
            ("count", "<u8"),  # u32 and the padding to 8
            ("velocity", "<f8", k),
            ("effort", "<u4"),
        ]
    )


def _joint_names(names: Sequence[str], frame_id: str) -> bytes:
    """frame_id, the names, and the length of `position`, up to its first value."""
    raw = _padded(_string(frame_id), 4, 8) + struct.pack("<I", len(names))
    for name in names:
        raw = _padded(raw, 4, 8) + _string(name)
    raw = _padded(raw, 4, 8) + struct.pack("<I", len(names))
    return _padded(raw, 8, 8)


def encode_joints(joints: Joints) -> list[bytes]:
    """`sensor_msgs/msg/JointState` messages; effort is empty."""
    names = _joint_names(joints.names, "base")
    layout = _joint_layout(names, len(joints.names))
    rows = np.zeros(len(joints), dtype=layout)
    rows["header"], rows["names"] = np.void(HEADER), np.void(names)
    _stamps(rows, joints.t)
    rows["count"] = len(joints.names)
    rows["position"], rows["velocity"] = joints.position, joints.velocity
    return _rows(rows.tobytes(), layout)


def decode_joints(messages: Messages) -> Joints:
    """Joints of JointState messages; all have the same names."""
    first, at = messages.first, 12

    def text() -> str:
        nonlocal at
        at += -(at - 4) % 4
        (length,) = struct.unpack_from("<I", first, at)
        at += 4 + length
        return first[at - length : at - 1].decode()

    frame_id = text()
    at += -(at - 4) % 4
    (count,) = struct.unpack_from("<I", first, at)
    at += 4
    names = tuple(text() for _ in range(count))
    rows = messages.rows(_joint_layout(_joint_names(names, frame_id), count))
    t = rows["sec"].astype(np.int64) * NS + rows["nanosec"]
    return Joints(t, messages.log_t, rows["position"], rows["velocity"], names)


def encode_exchanges(exchanges: Exchanges) -> list[bytes]:
    """`vrbench_msgs/msg/ClockExchange` messages."""
    rows = np.zeros(len(exchanges), dtype=_EXCHANGE_LAYOUT)
    rows["header"] = np.void(HEADER)
    rows["stamps"] = np.column_stack(
        (
            exchanges.sent,
            exchanges.remote_received,
            exchanges.remote_sent,
            exchanges.received,
        )
    )
    return _rows(rows.tobytes(), _EXCHANGE_LAYOUT)


def decode_exchanges(messages: Messages) -> Exchanges:
    """The exchanges of `vrbench_msgs/msg/ClockExchange` messages."""
    stamps = messages.rows(_EXCHANGE_LAYOUT)["stamps"]
    return Exchanges(*(stamps[:, i].copy() for i in range(4)))


def encode_states(states: States) -> list[bytes]:
    """`vrbench_msgs/msg/RobotState` messages."""
    rows = np.zeros(len(states), dtype=_STATE_LAYOUT)
    rows["header"] = np.void(HEADER)
    rows["t"], rows["receive"], rows["device"] = states.t, states.receive_t, states.device_t
    rows["speed_scaling"] = states.speed_scaling
    rows["safety"], rows["runtime"] = states.safety, states.runtime
    return _rows(rows.tobytes(), _STATE_LAYOUT)


def decode_states(messages: Messages) -> States:
    """The states of `vrbench_msgs/msg/RobotState` messages."""
    rows = messages.rows(_STATE_LAYOUT)
    return States(
        t=rows["t"],
        receive_t=rows["receive"],
        device_t=rows["device"],
        speed_scaling=rows["speed_scaling"],
        safety=rows["safety"],
        runtime=rows["runtime"],
    )


def encode_event(event: Event) -> bytes:
    """A `vrbench_msgs/msg/Event` message; the detail is JSON text."""
    raw = struct.pack("<iI", event.t // NS, event.t % NS) + _string(event.kind)
    return HEADER + _padded(raw, 4, 0) + _string(json.dumps(dict(event.detail), sort_keys=True))


def decode_event(message: bytes) -> Event:
    """The event of a `vrbench_msgs/msg/Event` message."""
    sec, nanosec, length = struct.unpack_from("<iII", message, 4)
    kind = message[16 : 16 + length - 1].decode()
    at = 16 + length
    at += -(at - 4) % 4
    (length,) = struct.unpack_from("<I", message, at)
    detail = json.loads(message[at + 4 : at + 4 + length - 1])
    return Event(sec * NS + nanosec, kind, detail)
