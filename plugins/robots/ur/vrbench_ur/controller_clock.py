"""The controller's time on the host's clock, from what it sends alone.

RTDE answers no time requests, so delays can't be halved: a packet that waited is late, none is
early, and the least of receive minus send time, second by second, is the map. It runs after the
controller by the least delay there is, some tenths of a millisecond on a cable of its own.
"""

from __future__ import annotations

import numpy as np

from vrbench.geometry import Ints
from vrbench.trajectory import NS

KEEP_S = 30
# The map never bends by more than this: stamps must go on increasing.
MOST_SLEW = 1e-3


class ControllerClock:
    """Maps a controller's stamps to the host's clock while they come in."""

    def __init__(self) -> None:
        self._least: dict[int, tuple[int, int]] = {}
        self._at = 0
        self._offset: float | None = None

    def to_host(self, device: Ints, received: Ints) -> Ints:
        """Host times (n,) [ns] of controller times (n,) [ns], increasing; and learns from them."""
        if not len(device):
            return device
        delay = received - device
        seconds = device // NS
        for second in np.unique(seconds):
            where = np.flatnonzero(seconds == second)
            k = where[np.argmin(delay[where])]
            new = (int(device[k]), int(delay[k]))
            old = self._least.get(int(second), new)
            self._least[int(second)] = min(old, new, key=lambda x: x[1])
        for second in sorted(self._least)[:-KEEP_S]:
            del self._least[second]
        wanted = self._estimate(int(device[-1]))
        if self._offset is None:
            self._offset, self._at = wanted, int(device[0])
        span = max(float(device[-1] - self._at), 1.0)
        step = float(np.clip(wanted - self._offset, -MOST_SLEW * span, MOST_SLEW * span))
        offsets = self._offset + step * (device - self._at) / span
        self._offset, self._at = self._offset + step, int(device[-1])
        return device + np.rint(offsets).astype(np.int64)

    def _estimate(self, at: int) -> float:
        """The offset at a controller time [ns]: the least delays' line, once there are some."""
        points = np.array(list(self._least.values()), dtype=np.int64)
        base = points[:, 1].min()
        t = (points[:, 0] - at) / NS
        excess = (points[:, 1] - base).astype(np.float64)
        if len(points) < 5:
            return float(base)
        slope, level = np.polyfit(t, excess, 1)
        return float(base) + float(level) if abs(slope) < MOST_SLEW * NS else float(base)
