"""Poses as their file has them, a TUM file or a topic of a take, to compare with other tools."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vrbench.errors import ConfigError, DataError
from vrbench.recording import cdr
from vrbench.recording.messages import Messages, read_messages
from vrbench.recording.take import METADATA
from vrbench.trajectory import NS, Stamped, read_tum_as_written


def split(source: str) -> tuple[Path, str | None]:
    """The file of FILE.tum or TAKE.mcap:TOPIC, and the topic."""
    file, dot, topic = source.partition(".mcap:")
    return (Path(f"{file}.mcap"), topic) if dot else (Path(source), None)


def read_poses(*sources: str) -> list[Stamped]:
    """The poses of each FILE.tum or TAKE.mcap:TOPIC; a take is read once.

    Raises:
        ConfigError: an MCAP file without a topic.
        DataError: as `read_topics` and `vrbench.trajectory.read_tum_as_written`.
    """
    wanted: dict[Path, list[str]] = {}
    for path, topic in map(split, sources):
        if topic is not None:
            wanted.setdefault(path, []).append(topic)
        elif path.suffix == ".mcap":
            raise ConfigError("which topic?", file=path, fix=f"{path}:/robot/tcp, for example")
    takes = {path: read_topics(path, topics) for path, topics in wanted.items()}
    return [
        read_tum_as_written(path) if topic is None else takes[path][topic]
        for path, topic in map(split, sources)
    ]


def read_topics(path: Path, topics: Sequence[str]) -> dict[str, Stamped]:
    """The poses of topics of PoseStamped by log time, stamps in float64 seconds as evo has them.

    Raises:
        DataError: no such file, not a whole MCAP file, no such topic, a topic of another type, a
            value that isn't finite.
    """
    messages, _ = read_messages(path, METADATA, set(topics).__contains__)
    poses = {m.topic: m for m in messages if m.schema == cdr.POSE_STAMPED}
    for topic in topics:
        if topic not in poses:
            other = next((m.schema for m in messages if m.topic == topic), None)
            raise DataError(
                f"the topic holds {other}" if other else "no such topic, or no messages in it",
                file=path,
                field=topic,
                fix=f"topics with poses: {', '.join(sorted(poses)) or 'none'}",
            )
    return {topic: _stamped(poses[topic], path) for topic in topics}


def _stamped(messages: Messages, path: Path) -> Stamped:
    samples = cdr.decode_poses(messages)
    if np.any(np.diff(samples.receive_t) < 0):
        samples = samples[np.argsort(samples.receive_t, kind="stable")]
    finite = np.isfinite(samples.pose.p).all(axis=1) & np.isfinite(samples.pose.q).all(axis=1)
    if not finite.all():
        bad = int(np.argmin(finite)) + 1
        raise DataError(
            f"pose {bad} holds a value that is not finite", file=path, field=messages.topic
        )
    # not t / NS, which rounds otherwise
    return Stamped(samples.pose_t // NS + (samples.pose_t % NS) * 1e-9, samples.pose)
