"""What devices send and takes hold, as columns: the one shape in which recordings are passed on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntFlag
from typing import Any

import numpy as np
import numpy.typing as npt

from vrbench.clocks import Exchanges
from vrbench.geometry import Bools, Floats, Ints, Transform, continuous_signs, quat_normalize
from vrbench.trajectory import QUATERNION_TOLERANCE, Trajectory


class Flag(IntFlag):
    """What a runtime says of a pose; the first four are OpenXR's location flags."""

    ORIENTATION_VALID = 1
    POSITION_VALID = 2
    ORIENTATION_TRACKED = 4
    POSITION_TRACKED = 8


GOOD = int(
    Flag.ORIENTATION_VALID | Flag.POSITION_VALID | Flag.ORIENTATION_TRACKED | Flag.POSITION_TRACKED
)


def believed(p: Floats, q: Floats, flags: Any) -> tuple[Transform, npt.NDArray[np.uint32]]:
    """Poses as a headset tells them, and its flags without those that can't be true.

    A position that isn't finite is no position, a quaternion far from unit length no orientation:
    their flags are cleared, and zeros and the identity stand in their place.

    Args:
        p: positions (n, 3) [m].
        q: quaternions (n, 4), xyzw.
        flags: what the headset says of each (n,), `Flag`.
    """
    places = np.asarray(np.isfinite(p).all(axis=1))
    with np.errstate(over="ignore", invalid="ignore"):
        turns = np.asarray(np.abs(np.linalg.norm(q, axis=1) - 1.0) < QUATERNION_TOLERANCE)
    allowed = np.where(places, Flag.POSITION_VALID | Flag.POSITION_TRACKED, 0)
    allowed |= np.where(turns, Flag.ORIENTATION_VALID | Flag.ORIENTATION_TRACKED, 0)
    pose = Transform(
        np.where(places[:, None], p, 0.0),
        quat_normalize(np.where(turns[:, None], q, [0.0, 0.0, 0.0, 1.0])),
    )
    return pose, np.asarray(flags, dtype=np.uint32) & allowed.astype(np.uint32)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Every pose a source sent, good or not, in order of arrival.

    Attributes:
        source_t: the source's own stamp (n,) [ns], on its own clock.
        pose_t: the time the pose refers to (n,) [ns]; on the recorder's clock where the take holds
            clock exchanges with the source, on the source's own where it doesn't.
        receive_t: when it arrived (n,) [ns], on the recorder's clock.
        pose: `T_parent_child` (n,).
        flags: what the source says of each pose (n,), `Flag`.
        epoch: world frame of each pose (n,); one more at every recentre.
    """

    source_t: Ints
    pose_t: Ints
    receive_t: Ints
    pose: Transform
    flags: npt.NDArray[np.uint32]
    epoch: npt.NDArray[np.uint32]

    @classmethod
    def of(
        cls, t: Ints, pose: Transform, *, receive_t: Ints | None = None, flags: int = GOOD
    ) -> Samples:
        """Samples of a source that gives one stamp a pose and no flags."""
        n = len(t)
        return cls(
            source_t=t,
            pose_t=t,
            receive_t=t if receive_t is None else receive_t,
            pose=pose,
            flags=np.full(n, flags, dtype=np.uint32),
            epoch=np.zeros(n, dtype=np.uint32),
        )

    @classmethod
    def concatenate(cls, parts: Sequence[Samples]) -> Samples:
        return cls(
            source_t=np.concatenate([x.source_t for x in parts]),
            pose_t=np.concatenate([x.pose_t for x in parts]),
            receive_t=np.concatenate([x.receive_t for x in parts]),
            pose=Transform.concatenate(x.pose for x in parts),
            flags=np.concatenate([x.flags for x in parts]),
            epoch=np.concatenate([x.epoch for x in parts]),
        )

    def __len__(self) -> int:
        return len(self.pose_t)

    def __getitem__(self, index: Any) -> Samples:
        return Samples(
            self.source_t[index],
            self.pose_t[index],
            self.receive_t[index],
            self.pose[index],
            self.flags[index],
            self.epoch[index],
        )

    @property
    def good(self) -> Bools:
        """Which poses (n,) are valid and tracked in position and orientation."""
        return (self.flags & GOOD) == GOOD

    @property
    def epochs(self) -> list[int]:
        """The epochs that good poses lie in."""
        return [int(epoch) for epoch in np.unique(self.epoch[self.good])]

    def trajectory(self) -> Trajectory:
        """The good poses by pose time; of poses with one and the same time the first is kept."""
        keep = np.flatnonzero(self.good)
        t, first = np.unique(self.pose_t[keep], return_index=True)
        pose = self.pose[keep[first]]
        return Trajectory(t, Transform(pose.p, continuous_signs(quat_normalize(pose.q))))


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """Joint states of a robot.

    Attributes:
        t: stamps (n,) [ns].
        receive_t: when they arrived (n,) [ns].
        position: joint angles (n, k) [rad].
        velocity: joint speeds (n, k) [rad/s].
        names: the joints' names (k,).
    """

    t: Ints
    receive_t: Ints
    position: Floats
    velocity: Floats
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, slots=True, eq=False)
class States:
    """What a robot's controller says of itself.

    Attributes:
        t: stamps (n,) [ns].
        receive_t: when they arrived (n,) [ns].
        device_t: the controller's own time (n,) [ns].
        speed_scaling: share of full speed it moves at (n,), 0..1.
        safety: the maker's safety bits (n,).
        runtime: the maker's state of the program (n,).
    """

    t: Ints
    receive_t: Ints
    device_t: Ints
    speed_scaling: Floats
    safety: npt.NDArray[np.uint32]
    runtime: npt.NDArray[np.uint32]

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened in a take: `phase`, `loop`, `gap`, `recentre`, ...

    Attributes:
        t: when [ns], on the recorder's clock.
        kind: what.
        detail: more of it, in JSON's types.
    """

    t: int
    kind: str
    detail: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """A whole take, decoded.

    Attributes:
        poses: pose streams by name: `headset/eye`, `robot/tcp`, `robot/target`, `mocap/<body>`.
        joints: joint streams by name: `robot/joints`, `robot/target_joints`; and
            `headset/frames`, numbers of every frame that are no joints but have names likewise.
        events: all events by time.
        clocks: clock exchanges by source: `optitrack`, `headset`.
        metadata: facts of the take, text by name.
        states: states of robots' controllers by name: `robot/state`.
    """

    poses: Mapping[str, Samples]
    joints: Mapping[str, Joints] = field(default_factory=dict)
    events: Sequence[Event] = ()
    clocks: Mapping[str, Exchanges] = field(default_factory=dict)
    metadata: Mapping[str, str] = field(default_factory=dict)
    states: Mapping[str, States] = field(default_factory=dict)
