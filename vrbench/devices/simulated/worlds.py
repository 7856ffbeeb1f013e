"""The worlds of the simulated headset: a new one at every recentre, and all of them drift."""

from __future__ import annotations

from typing import Any

import numpy as np

from vrbench.devices.simulated.noise import rng_of
from vrbench.devices.simulated.stage import as_json
from vrbench.devices.specs import Tracking
from vrbench.geometry import Floats, Ints, Transform, quat_multiply, quat_rotate, rotvec_to_quat
from vrbench.trajectory import NS

# From base axes (z up) to those of a world or a room of cameras (y up).
Y_UP = Transform.of((0.0, 0.0, 0.0), (-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))


class Worlds:
    """Those of one mount, over which the headset's app runs on.

    They and their drift are drawn for the mount alone, and drift since the rig was opened: a run
    that is gone on with finds them as they were.

    Args:
        seed: of everything random in the run.
        mount: the n-th fixing of the headset.
        tracking: how they drift.
        opened: when the rig was opened [ns], host clock.

    Attributes:
        name: of this numbering of epochs.
        recentres: when they begin, but for the first (k,) [ns], increasing.
    """

    def __init__(self, seed: int, mount: int, tracking: Tracking, opened: int) -> None:
        self.name = f"seed {seed} mount {mount}"
        self.recentres: Ints = np.zeros(0, dtype=np.int64)
        self._seed, self._mount, self._opened = seed, str(mount), opened
        rng = rng_of(seed, "drift", self._mount)
        way = rng.normal(size=3)
        self._drift: Floats = way / np.linalg.norm(way) * tracking.drift_m_per_min / 60.0
        self._turn = float(rng.choice((-1.0, 1.0)) * tracking.drift_rad_per_min / 60.0)
        self._worlds = [self._drawn(0)]

    def recentre(self, at: Ints | Floats) -> None:
        """New worlds from these times on (k,) [ns]."""
        every = np.concatenate((self.recentres, np.rint(at).astype(np.int64)))
        self.recentres = np.sort(every)
        self._worlds = [self._drawn(epoch) for epoch in range(len(every) + 1)]

    def forget_after(self, t: int) -> None:
        """Recentres that were planned for later than t [ns] don't come about."""
        self.recentres = self.recentres[self.recentres <= t]

    def epoch(self, t: Ints) -> Ints:
        """Which world holds at each time (n,) [ns]."""
        found: Ints = np.searchsorted(self.recentres, t, side="right")
        return found

    def seen(self, t: Ints, eye: Transform, start: Transform) -> Transform:
        """`T_world_eye` (n,) of `T_base_eye` (n,) at times t (n,) [ns].

        Worlds turn about `start` (1,), where the eye was when the rig was opened.
        """
        epoch, since = self.epoch(t), (t - self._opened)[:, None] / NS
        worlds = Transform(
            np.array([world.p for world in self._worlds])[epoch],
            np.array([world.q for world in self._worlds])[epoch],
        )
        pose = worlds @ eye
        pivot = (worlds @ Transform(start.p[0], start.q[0])).p
        turn = rotvec_to_quat(since * np.array([0.0, self._turn, 0.0]))
        p = pivot + quat_rotate(turn, pose.p - pivot) + since * self._drift
        return Transform(p, quat_multiply(turn, pose.q))

    def truth(self, started: int) -> dict[str, Any]:
        """What is true of a take that began at `started` [ns], in JSON's types."""
        base_worlds = [as_json(world.inverse()) for world in self._worlds]
        return {
            "base_world": base_worlds[int(np.searchsorted(self.recentres, started))],
            "base_worlds": base_worlds,
            "recentre_s": ((self.recentres - started) / NS).tolist(),
            "drift_epoch_ns": self._opened,
            "drift_m_per_s": self._drift.tolist(),
            "drift_yaw_rad_per_s": self._turn,
        }

    def _drawn(self, epoch: int) -> Transform:
        """`T_world_base` of an epoch: upright, anywhere."""
        rng = rng_of(self._seed, "world", self._mount, str(epoch))
        yaw = rotvec_to_quat(np.array([0.0, rng.uniform(-np.pi, np.pi), 0.0]))
        return Transform(rng.normal(0.0, 0.5, 3), yaw) @ Y_UP
