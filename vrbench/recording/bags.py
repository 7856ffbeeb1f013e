"""Poses of ROS bags, decoded in bulk from the messages' bytes, so that no ROS is needed.

The types read here share a shape in ROS 1 and in CDR: a header with its stamp in bytes 4..12, one
or two frame names, then seven float64 `x y z qx qy qz qw` at a fixed distance from the end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vrbench.errors import DataError
from vrbench.geometry import Floats, Ints, Transform
from vrbench.recording.checks import imported_poses
from vrbench.recording.importer import AxesOptions, Imported
from vrbench.trajectory import NS

STAMP = slice(4, 12)
POSE_BYTES = 7 * 8


@dataclass(frozen=True, slots=True)
class _Layout:
    """Of a message type: how many frame names it has, how many bytes follow its pose."""

    names: int
    tail: int


LAYOUTS = {
    "geometry_msgs/msg/PoseStamped": _Layout(1, 0),
    "geometry_msgs/msg/PoseWithCovarianceStamped": _Layout(1, 36 * 8),
    "geometry_msgs/msg/TransformStamped": _Layout(2, 0),
    "nav_msgs/msg/Odometry": _Layout(2, (36 + 6 + 36) * 8),
}
"""The message types that can be read."""


class BagOptions(AxesOptions):
    """Which poses of a bag are meant.

    Attributes:
        topic: the topic's full name.
    """

    topic: str


@dataclass(frozen=True, slots=True)
class BagKind:
    """ROS 1 or ROS 2.

    Attributes:
        name: for messages.
        open: gives the library's reader of a path; it imports the library.
        cdr: whether messages are CDR; else they are ROS 1's serialisation.
        fix: what to do with a bag that can't be read.
    """

    name: str
    open: Callable[[Path], AbstractContextManager[Any]]
    cdr: bool
    fix: str


def read_bag(path: Path, options: BagOptions, kind: BagKind) -> Imported:
    """The poses of one topic: header stamp = source and pose time, bag time = receive time.

    Raises:
        DataError: no such file, not a bag of this kind, a bag cut short; no such topic (those
            with poses are named), a type that can't be read, no messages, several frames,
            and as `vrbench.recording.checks.imported_poses`.
    """
    topic = options.topic
    if not path.exists():
        raise DataError("no such file", file=path)
    try:
        with kind.open(path) as bag:
            chosen, layout = _choose(bag.connections, topic, path)
            messages = [(t, raw) for _, t, raw in bag.messages(chosen)]
    except DataError:
        raise
    except Exception as error:  # a damaged bag breaks the library in any place
        reason = str(error) or type(error).__name__
        raise DataError(
            f"can't be read as a {kind.name} bag: {reason}", file=path, fix=kind.fix
        ) from error
    if not messages:
        raise DataError("the topic has no messages", file=path, field=topic)
    received = np.array([t for t, _ in messages], dtype=np.int64)
    raws = [bytes(raw) for _, raw in messages]
    _check_frames(raws, layout, kind.cdr, path, topic)
    stamps, poses = _decode(raws, layout, kind.cdr)
    repairs: tuple[str, ...] = ()
    if not stamps.any():
        stamps = received
        repairs = ("the headers carry no stamps: the bag's receive times stand in for them",)
    pose = options.to_openxr(Transform(poses[:, :3], poses[:, 3:]))
    return imported_poses(
        stamps,
        pose.p,
        pose.q,
        file=path,
        receive_t=received,
        row="message",
        repairs=repairs,
    )


def _choose(connections: Sequence[Any], topic: str, path: Path) -> tuple[list[Any], _Layout]:
    """The connections of a topic, and the layout of its messages."""
    chosen = [x for x in connections if x.topic == topic]
    if not chosen:
        raise DataError("no such topic", file=path, field=topic, fix=_offer(connections))
    types = sorted({x.msgtype for x in chosen})
    if len(types) > 1 or types[0] not in LAYOUTS:
        raise DataError(
            f"the topic holds {', '.join(types)}",
            file=path,
            field=topic,
            fix=f"{', '.join(LAYOUTS)} can be read; {_offer(connections)}",
        )
    return chosen, LAYOUTS[types[0]]


def _offer(connections: Sequence[Any]) -> str:
    """Which topics there are: those with poses, else all."""
    poses = sorted({f"{x.topic} ({x.msgtype})" for x in connections if x.msgtype in LAYOUTS})
    if poses:
        return f"topics with poses: {', '.join(poses)}"
    others = sorted({f"{x.topic} ({x.msgtype})" for x in connections})
    return f"no topic has poses; there are: {', '.join(others) or 'none'}"


def _decode(raws: Sequence[bytes], layout: _Layout, cdr: bool) -> tuple[Ints, Floats]:
    """Stamps (n,) [ns] and poses (n, 7) of messages whose layout was checked."""
    # seconds are signed in ROS 2, unsigned in ROS 1; nanoseconds fit either
    stamps = np.frombuffer(b"".join(raw[STAMP] for raw in raws), "<i4" if cdr else "<u4")
    sec, nanosec = stamps.astype(np.int64).reshape(-1, 2).T
    start = POSE_BYTES + layout.tail
    poses = b"".join(raw[len(raw) - start : len(raw) - layout.tail] for raw in raws)
    return sec * NS + nanosec, np.frombuffer(poses, "<f8").reshape(-1, 7)


def _check_frames(
    raws: Sequence[bytes], layout: _Layout, cdr: bool, path: Path, topic: str
) -> None:
    """Refuses messages of another shape, and poses that are given in several frames."""
    end = POSE_BYTES + layout.tail
    found: dict[bytes, tuple[str, ...]] = {}
    for number, raw in enumerate(raws, 1):
        between = raw[STAMP.stop : max(len(raw) - end, 0)]
        if between in found:
            continue
        names = _names(between, layout.names, cdr)
        if names is None or (cdr and raw[:2] != b"\x00\x01"):
            raise DataError(
                f"message {number} is damaged or of another layout", file=path, field=topic
            )
        found[between] = names
    frames = sorted({" to ".join(names) or "''" for names in found.values()})
    if len(frames) > 1:
        raise DataError(
            f"poses are given in {len(frames)} frames: {', '.join(frames)}",
            file=path,
            field=topic,
            fix="one frame a topic",
        )


def _names(between: bytes, count: int, cdr: bool) -> tuple[str, ...] | None:
    """The frame names that lie between stamp and pose; None where they don't fill the place."""
    at, names = 0, []
    for _ in range(count):
        at += -at % 4 if cdr else 0
        size = int.from_bytes(between[at : at + 4], "little")
        at += 4 + size
        if at > len(between):
            return None
        names.append(between[at - size : at].rstrip(b"\0").decode(errors="replace"))
    at += -at % 8 if cdr else 0
    return tuple(names) if at == len(between) else None
