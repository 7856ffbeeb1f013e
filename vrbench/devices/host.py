"""The recorder's clock where devices are real."""

from __future__ import annotations

import time

import numpy as np

from vrbench.clocks import Exchanges


class RealClock:
    """UTC as it was when this began, carried on by the monotonic clock.

    NTP may step UTC in the midst of a take; this clock it can't bend. `reading` tells how far the
    two have come apart.
    """

    def __init__(self) -> None:
        self._anchor_ns = time.time_ns() - time.monotonic_ns()

    def now(self) -> int:
        return self._anchor_ns + time.monotonic_ns()

    def wait(self, seconds: float) -> None:
        time.sleep(seconds)

    def reading(self) -> Exchanges:
        """The clock and UTC at one moment, as an exchange whose remote times are UTC."""
        sent = self.now()
        utc = time.time_ns()
        stamps = (np.array([t], dtype=np.int64) for t in (sent, utc, utc, self.now()))
        return Exchanges(*stamps)
