"""One topic of an MCAP file, as its poses and header stamps, for comparison with other tools."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vrbench.errors import DataError
from vrbench.recording import cdr
from vrbench.recording.messages import read_messages
from vrbench.recording.take import METADATA
from vrbench.trajectory import NS, Stamped


def read_topic(path: Path, topic: str) -> Stamped:
    """The poses of a topic of PoseStamped by log time, stamps in float64 seconds as evo has them.

    Raises:
        DataError: no such file, not a whole MCAP file, no such topic, a topic of another type, a
            value that isn't finite.
    """
    messages, _ = read_messages(path, METADATA)
    poses = {m.topic: m for m in messages if m.schema == cdr.POSE_STAMPED}
    if topic not in poses:
        other = next((m.schema for m in messages if m.topic == topic), None)
        raise DataError(
            f"the topic holds {other}" if other else "no such topic, or no messages in it",
            file=path,
            field=topic,
            fix=f"topics with poses: {', '.join(sorted(poses)) or 'none'}",
        )
    samples = cdr.decode_poses(poses[topic])
    samples = samples[np.argsort(samples.receive_t, kind="stable")]
    finite = np.isfinite(samples.pose.p).all(axis=1) & np.isfinite(samples.pose.q).all(axis=1)
    if not finite.all():
        bad = int(np.argmin(finite)) + 1
        raise DataError(f"pose {bad} holds a value that is not finite", file=path, field=topic)
    # not t / NS, which rounds otherwise
    return Stamped(samples.pose_t // NS + (samples.pose_t % NS) * 1e-9, samples.pose)
