"""What the emulated arm carries, for the emulators of other devices: it swings as a mount does."""

from __future__ import annotations

import math
from collections.abc import Sequence

from vrbench.devices.emulated import StageWriter
from vrbench.trajectory import NS
from vrbench_ur.emulator.twin import TICK_S, Twin

# A rod of 0.3 m with a head on it: made up, as stiff as such mounts are.
FREQUENCY_HZ, DAMPING = 12.0, 0.04
# It is reckoned at every fourth tick: the emulator has to keep up on busy computers.
EVERY = 4
STEP_S = EVERY * TICK_S


class Mount:
    """A mass on a spring, pulled along by the TCP; the encoders feel nothing of it.

    Args:
        twin: the arm.
        stage: where is written down where the mass is.
    """

    def __init__(self, twin: Twin, stage: StageWriter) -> None:
        self._twin, self._stage = twin, stage
        self._place = twin.tcp(twin.q)[:3]
        self._velocity = [0.0] * 3
        self._swing, self._speed = [0.0] * 3, [0.0] * 3
        self._ticks = 0

    def tick(self, at_s: float) -> None:
        """The tick at a monotonic time [s] is over."""
        self._ticks += 1
        if self._ticks % EVERY:
            return
        self._pull(self._twin.tcp(self._twin.q)[:3])
        pose = self._twin.tcp(self._twin.actual)
        place = tuple(x + s for x, s in zip(pose[:3], self._swing, strict=True))
        self._stage.put(round(at_s * NS), place, quaternion(pose[3:]))

    def _pull(self, place: list[float]) -> None:
        """The TCP is planned to be at `place` [m]: its acceleration swings the mass."""
        w = 2.0 * math.pi * FREQUENCY_HZ
        for k, x in enumerate(place):
            velocity = (x - self._place[k]) / STEP_S
            acceleration = (velocity - self._velocity[k]) / STEP_S
            self._place[k], self._velocity[k] = x, velocity
            spring = w * w * self._swing[k] + 2.0 * DAMPING * w * self._speed[k]
            self._speed[k] -= (acceleration + spring) * STEP_S
            self._swing[k] += self._speed[k] * STEP_S


def quaternion(rotvec: Sequence[float]) -> tuple[float, float, float, float]:
    """The quaternion (xyzw) of a rotation vector (3) [rad]."""
    angle = math.sqrt(sum(x * x for x in rotvec))
    k = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    x, y, z = (k * v for v in rotvec)
    return x, y, z, math.cos(0.5 * angle)
