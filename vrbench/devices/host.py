"""The recorder's clock where devices are real."""

from __future__ import annotations

import time

from vrbench.streams import Event


class RealClock:
    """UTC as it was when this began, carried on by the monotonic clock.

    NTP may step UTC in the midst of a take; this clock it can't bend. `reading` says how far the
    two have come apart.
    """

    def __init__(self) -> None:
        self._anchor_ns = time.time_ns() - time.monotonic_ns()

    def now(self) -> int:
        return self._anchor_ns + time.monotonic_ns()

    def wait(self, seconds: float) -> None:
        time.sleep(seconds)

    def reading(self) -> Event:
        """The clock and UTC at one moment, for the take."""
        before = self.now()
        utc = time.time_ns()
        now = (before + self.now()) // 2
        return Event(now, "utc", {"utc_ns": utc, "ahead_ns": now - utc})
