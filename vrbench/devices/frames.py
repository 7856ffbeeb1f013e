"""Frames of a headset that is elsewhere: what one is, and the time its pose refers to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vrbench.geometry import Floats, Ints

# What a frame is: times [ms] on the headset's clock, a pose [m], velocities [m/s, rad/s].
COLUMNS = (
    "callback_ms",
    "display_ms",
    "now_ms",
    *("x", "y", "z"),
    *("qx", "qy", "qz", "qw"),
    *("vx", "vy", "vz"),
    *("wx", "wy", "wz"),
    "flags",
    "epoch",
)
CALLBACK, DISPLAY, NOW = 0, 1, 2
P, Q, VELOCITIES = slice(3, 6), slice(6, 10), slice(10, 16)
FLAGS, EPOCH = 16, 17

MS = 1_000_000
# A pose is for a time near its frame; anything else is a time of another clock.
FARTHEST_MS = 1000.0


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Frames that arrived together.

    Attributes:
        rows: `COLUMNS` of each (n, 18).
        epochs: of each (n,), numbered over all runs of the headset's app.
        receive_t: when they arrived [ns], on the recorder's clock.
        origin_ns: what their milliseconds are counted from [ns].
    """

    rows: Floats
    epochs: Ints
    receive_t: int
    origin_ns: int

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, part: Any) -> Frames:
        return Frames(self.rows[part], self.epochs[part], self.receive_t, self.origin_ns)

    @property
    def made(self) -> Ints:
        """When each was made (n,) [ns], on the headset's clock."""
        return ns_of(self.rows[:, NOW], self.origin_ns)

    @property
    def called(self) -> Ints:
        """The runtime's own time of each (n,) [ns], on the headset's clock."""
        return ns_of(self.rows[:, CALLBACK], self.origin_ns)

    @property
    def refers(self) -> Ints:
        """The time that each pose refers to (n,) [ns], on the headset's clock.

        Its display time where the runtime gives one, else the frame's own; where that is of
        another clock, the moment at which the pose was asked for.
        """
        now = self.rows[:, NOW]
        time = now
        for column in (CALLBACK, DISPLAY):
            told = self.rows[:, column]
            with np.errstate(invalid="ignore"):
                time = np.where(np.abs(told - now) < FARTHEST_MS, told, time)
        return ns_of(time, self.origin_ns)


def ns_of(ms: Floats, origin_ns: int) -> Ints:
    """Times [ns] on the headset's clock since 1970, of milliseconds after its origin."""
    return np.rint(ms * MS).astype(np.int64) + origin_ns
