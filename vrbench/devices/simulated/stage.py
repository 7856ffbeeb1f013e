"""The stage: where the simulated flange is at any time, and what is true of the take."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vrbench.devices.ports import HostClock, Occlusion
from vrbench.devices.simulated.covering import Covering
from vrbench.geometry import Ints, Transform
from vrbench.trajectory import NS, Trajectory

# Virtual time starts at a fixed instant, so that one seed gives one take, byte for byte.
START_NS = 1_700_000_000 * NS


class VirtualClock:
    """A clock that moves only when something waits."""

    def __init__(self) -> None:
        self._now = START_NS

    def now(self) -> int:
        return self._now

    def wait(self, seconds: float) -> None:
        self._now += round(seconds * NS)

    def reading(self) -> None:
        """Virtual time has no UTC beside it."""


@dataclass(slots=True, eq=False)
class Stage:
    """What the simulated devices of a rig share; nothing that evaluates ever sees it.

    Attributes:
        mount: the n-th fixing of the headset, from 1.
        handled: how often hands have been at the headset in this mount.
        truth: what is true of the current take, by device, in JSON's types.
        recentred: when the headset was given a new origin, host clock [ns].
        covering: of its cameras, on the host clock.
    """

    mount: int = 1
    handled: int = 0
    truth: dict[str, dict[str, Any]] = field(default_factory=dict)
    recentred: list[int] = field(default_factory=list)
    covering: Covering = field(default_factory=Covering)
    _paths: list[tuple[Trajectory, Trajectory]] = field(default_factory=list)

    def move(self, path: Trajectory, felt: Trajectory | None = None) -> None:
        """The flange will follow `path`, `T_base_tcp` on the host clock, and rest after it.

        Where the robot's encoders feel something else, as they do where the mount vibrates, that is
        `felt`, at the same times.
        """
        self._paths.append((path, felt or path))

    def tcp(self, t: Ints) -> Transform:
        """Where the flange truly is, `T_base_tcp` (m,), at host times t (m,) [ns]."""
        return self._at(t, 0)

    def encoders(self, t: Ints) -> Transform:
        """Where the robot's encoders feel the flange, `T_base_tcp` (m,)."""
        return self._at(t, 1)

    def _at(self, t: Ints, which: int) -> Transform:
        if not self._paths:
            raise ValueError("nothing has placed the flange yet")
        starts = np.array([path.t[0] for path, _ in self._paths])
        of = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, None)
        p, q = np.empty((len(t), 3)), np.empty((len(t), 4))
        for index in np.unique(of):
            path, where = self._paths[index][which], of == index
            pose = path.at(np.clip(t[where], path.t[0], path.t[-1]))
            p[where], q[where] = pose.p, pose.q
        return Transform(p, q)


class SimulatedOperator:
    """Does on the stage what a person is asked to do in a lab."""

    def __init__(self, stage: Stage, host: HostClock) -> None:
        self._stage, self._host = stage, host

    def remount(self, mount: int) -> None:
        self._stage.mount, self._stage.handled = mount, 0

    def cover(self, occlusion: Occlusion) -> None:
        self._stage.handled += 1
        self._stage.covering.cover(self._host.now(), occlusion.share)

    def recentre(self) -> None:
        self._stage.recentred.append(self._host.now())


def as_json(pose: Transform) -> dict[str, list[float]]:
    """One transform as truth files keep it."""
    return {"p_m": pose.p.tolist(), "q_xyzw": pose.q.tolist()}
