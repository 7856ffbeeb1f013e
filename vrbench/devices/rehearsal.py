"""Known movements that a stand-in for a device plays, so that conformance can be proved.

Public to authors of plugins: a device spec's `stand_in` is given a `Rehearsal`, sends what it shows
by the vendor's own protocol and in the vendor's own convention, and yields the options with which
the plugin finds it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from vrbench.geometry import Bools, Floats, Ints, Transform, rotvec_to_quat
from vrbench.trajectory import NS

LOST_EVERY_S, LOST_FROM_S, LOST_UNTIL_S = 1.6, 0.7, 1.0
RECENTRE_EVERY_S = 2.0
# Where a recentre puts the world's origin: a step aside and a turn of yaw, as users do it.
T_NEW_OLD = Transform.of((0.4, 0.0, -0.3), (0.0, np.sin(0.4), 0.0, np.cos(0.4)))


@dataclass(frozen=True, slots=True)
class Moment:
    """What a device sees at one moment, in OpenXR's convention.

    Attributes:
        t: the recorder's time [ns].
        p: position (3,) [m].
        q: quaternion (4,), xyzw.
        tracked: whether it is tracked; where not, the pose means nothing.
        epoch: which world frame it is in; one more after every recentre.
    """

    t: int
    p: Floats
    q: Floats
    tracked: bool
    epoch: int


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """A head that moves on all axes, is lost for 0.3 s in every 1.6, and recentres every 2 s.

    Attributes:
        now: the recorder's time [ns].
        began: when it began, by that clock [ns].
        rate_hz: poses a second that the stand-in sends.
        recentres: whether the world is given a new origin; cameras on walls have but one.
    """

    now: Callable[[], int]
    began: int
    rate_hz: float
    recentres: bool = True

    def seconds(self, t: Ints) -> Floats:
        """Times since it began (n,) [s], of the recorder's times (n,) [ns]."""
        since: Floats = (t - self.began) / NS
        return since

    def pose(self, t: Ints) -> Transform:
        """`T_world_eye` (n,) at the recorder's times (n,) [ns]; for cameras `T_mocap_body`."""
        s = self.seconds(t)
        p = (0.25 * np.sin(1.3 * s), 1.4 + 0.12 * np.sin(2.1 * s), 0.18 * np.sin(1.7 * s + 1.0))
        r = (0.35 * np.sin(1.9 * s), 0.7 * np.sin(1.1 * s + 0.3), 0.2 * np.sin(2.7 * s))
        head = Transform(np.stack(p, axis=-1), rotvec_to_quat(np.stack(r, axis=-1)))
        moved = T_NEW_OLD @ head
        odd = (self.epoch(t) % 2 == 1)[:, None]
        return Transform(np.where(odd, moved.p, head.p), np.where(odd, moved.q, head.q))

    def tracked(self, t: Ints) -> Bools:
        """Whether it is tracked (n,) at the recorder's times (n,) [ns]."""
        into = self.seconds(t) % LOST_EVERY_S
        return np.asarray((into < LOST_FROM_S) | (into >= LOST_UNTIL_S))

    def epoch(self, t: Ints) -> Ints:
        """The world frame (n,) at the recorder's times (n,) [ns]."""
        passed = np.floor(self.seconds(t) / RECENTRE_EVERY_S).astype(np.int64)
        return passed if self.recentres else np.zeros_like(passed)

    def moment(self, t: int) -> Moment:
        """What the device sees at the recorder's time t [ns]."""
        at = np.array([t], dtype=np.int64)
        pose = self.pose(at)
        return Moment(t, pose.p[0], pose.q[0], bool(self.tracked(at)[0]), int(self.epoch(at)[0]))

    @contextmanager
    def playing(self, show: Callable[[Moment], None]) -> Iterator[None]:
        """Calls `show` with each moment, at the rate, from a thread that ends with the block.

        Raises:
            Exception: what `show` raised, when the block ends.
        """
        over = threading.Event()
        failed: list[Exception] = []

        def play() -> None:
            due = time.perf_counter()
            while not over.wait(max(0.0, due - time.perf_counter())):
                due += 1.0 / self.rate_hz
                try:
                    show(self.moment(self.now()))
                except Exception as error:
                    failed.append(error)
                    return

        thread = threading.Thread(target=play, name="vrbench stand-in", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join(5.0)
        if failed:
            raise failed[0]
