"""A motion: what is replayed, with the digest that says two takes replayed the same."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass

import numpy as np

from vrbench.errors import ConfigError
from vrbench.geometry import Transform
from vrbench.trajectory import NS, Trajectory

DIGEST_STEP = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A head motion.

    Attributes:
        name: name and version, `shooter-1`.
        title: what it is, for people.
        trajectory: `T_eye0_eye`, stamps from 0, the first pose the identity; y is up.
        source: where it comes from.
    """

    name: str
    title: str
    trajectory: Trajectory
    source: str

    @property
    def digest(self) -> str:
        """Of the name and of the values rounded to 1e-6 m, s and quaternion components."""
        t = np.rint(self.trajectory.t / (DIGEST_STEP * NS)).astype(np.int64)
        values = np.column_stack((self.trajectory.pose.p, self.trajectory.pose.q)) / DIGEST_STEP
        columns = np.column_stack((t, np.rint(values).astype(np.int64)))
        return digest_of({"motion": self.name, "up": "y"}, columns.astype("<i8").tobytes())


def digest_of(header: dict[str, object], payload: bytes = b"") -> str:
    """sha256 of a header as canonical JSON, and of what follows it."""
    text = json.dumps(header, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode() + payload).hexdigest()


def digest_of_name(name: str) -> str:
    """The digest of a motion that is known by its name only."""
    return digest_of({"motion": name})


def at_speed(motion: Motion, speed: float) -> Trajectory:
    """The motion `speed` times as fast.

    Raises:
        ConfigError: a speed that isn't positive.
    """
    if not speed > 0:
        raise ConfigError(f"speed is {speed}", field="speed", fix="a positive number")
    t = np.rint(motion.trajectory.t / speed).astype(np.int64)
    return Trajectory(t, motion.trajectory.pose)


def relative_to_first(trajectory: Trajectory) -> Trajectory:
    """Any head trajectory as `T_eye0_eye` with stamps from 0."""
    start: Transform = trajectory.pose[0].inverse()
    return Trajectory(trajectory.t - trajectory.t[0], start @ trajectory.pose)
