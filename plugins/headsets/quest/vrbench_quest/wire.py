"""Datagrams between the Unity logger and the recorder, little-endian: see unity/README.md.

Every datagram starts with `VRBQ`, the version, its kind, and the token of what it belongs to: of
the session for greetings and control, of the take for poses. Who lacks it isn't listened to.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrbench.devices.frames import COLUMNS, VELOCITIES
from vrbench.geometry import UNITY, Floats, Transform

MAGIC = b"VRBQ"
VERSION = 1
HEAD = struct.Struct("<4sBB8s")
LARGEST = 1400
# From the headset.
HELLO, POSES, PONG, DONE, EVENT = 1, 2, 3, 4, 5
# To the headset.
PING, START, STOP = 16, 17, 18
TOKEN_BYTES = 8

BATCH = struct.Struct("<IH")
PONG_BODY = struct.Struct("<Iqq")
EVENT_BODY = struct.Struct("<Iq")
COMMAND = struct.Struct("<I")
POSE = np.dtype(
    [
        ("time_ns", "<i8"),
        ("moment", "u1"),  # 0 in Update, 1 right before rendering
        ("flags", "u1"),
        ("present", "u1"),
        ("spare", "u1"),
        ("epoch", "<u4"),
        ("p", "<f4", 3),
        ("q", "<f4", 4),
        ("v", "<f4", 3),
        ("w", "<f4", 3),
    ]
)
# Times of a clock that counts from some start, 36 years from it at most: sums stay within int64.
LATEST_NS = 2**60
MOMENTS = {"update": 0, "render": 1}


class WireError(Exception):
    """A datagram is not what the logger sends."""


@dataclass(frozen=True, slots=True)
class Datagram:
    """One datagram, its head read.

    Attributes:
        kind: what it is.
        token: what it belongs to.
        body: the rest.
    """

    kind: int
    token: bytes
    body: bytes


def pack(kind: int, token: bytes, body: bytes = b"") -> bytes:
    """A datagram."""
    return HEAD.pack(MAGIC, VERSION, kind, token) + body


def unpack(data: bytes) -> Datagram:
    """A datagram's head.

    Raises:
        WireError: not ours, of another version, too large.
    """
    if len(data) < HEAD.size or len(data) > LARGEST:
        raise WireError(f"a datagram of {len(data)} bytes")
    magic, version, kind, token = HEAD.unpack_from(data)
    if magic != MAGIC:
        raise WireError("a datagram of something else")
    if version != VERSION:
        raise WireError(f"a logger of version {version}, this is {VERSION}")
    return Datagram(kind, token, data[HEAD.size :])


def poses_of(body: bytes) -> tuple[int, np.ndarray[Any, Any]]:
    """The number of the first sample, and the samples.

    Raises:
        WireError: another length than it says, times or flags out of their range.
    """
    if len(body) < BATCH.size:
        raise WireError("poses without their number")
    first, count = BATCH.unpack_from(body)
    if not count or len(body) != BATCH.size + count * POSE.itemsize:
        raise WireError(f"{count} poses in {len(body)} bytes")
    samples = np.frombuffer(body, POSE, offset=BATCH.size)
    if samples["flags"].max() > 15 or samples["moment"].max() > 1:
        raise WireError("flags or moment of a pose")
    check_times(*samples["time_ns"].tolist())
    return first, samples


def check_times(*times_ns: int) -> None:
    """Refuses times that no clock of a headset has.

    Raises:
        WireError: one of them is past `LATEST_NS`.
    """
    for time_ns in times_ns:
        if abs(time_ns) > LATEST_NS:
            raise WireError(f"a time of {time_ns} ns")


def frames_of(samples: np.ndarray[Any, Any]) -> Floats:
    """Samples as frames (n, 18) of a link, in OpenXR's convention.

    Unity's turns are left-handed: an angular velocity is mirrored as a rotation is.
    """
    rows = np.full((len(samples), len(COLUMNS)), np.nan)
    ms = samples["time_ns"] / 1e6
    rows[:, 0] = rows[:, 2] = ms
    with np.errstate(invalid="ignore", over="ignore"):
        pose = UNITY.to_openxr(
            Transform(samples["p"].astype(np.float64), samples["q"].astype(np.float64))
        )
        turns = Transform(
            samples["v"].astype(np.float64),
            np.hstack((samples["w"], np.ones((len(samples), 1)))).astype(np.float64),
        )
        moved = UNITY.to_openxr(turns)
    rows[:, 3:6], rows[:, 6:10] = pose.p, pose.q
    rows[:, VELOCITIES] = np.hstack((moved.p, moved.q[:, :3]))
    rows[:, 16], rows[:, 17] = samples["flags"], samples["epoch"]
    return rows


def facts_of(body: bytes) -> dict[str, Any]:
    """What a logger says of itself when it greets.

    Raises:
        WireError: no JSON object of plain values, or no name for this run.
    """
    try:
        facts = json.loads(body.decode())
        # what JSON has no words for, Python reads all the same: no number, half a character
        json.dumps(facts, allow_nan=False, ensure_ascii=False).encode()
    except (ValueError, RecursionError):
        raise WireError("a greeting that is no JSON") from None
    plain = isinstance(facts, dict) and all(
        isinstance(value, str | int | float | bool) for value in facts.values()
    )
    if not plain or not isinstance(facts.get("run"), str) or not facts["run"]:
        raise WireError("a greeting without the name of its run")
    return facts
