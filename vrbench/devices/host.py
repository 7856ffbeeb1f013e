"""The recorder's clock where devices are real."""

from __future__ import annotations

import time


class SystemClock:
    """UTC as the system told it once, carried on by a clock that nobody sets.

    A step of the system's time during a run (NTP, a person) is not seen: intervals stay true.
    """

    def __init__(self) -> None:
        # the reading whose bracket is the narrowest of a few: a pause between two calls would stay
        readings = []
        for _ in range(5):
            before, utc, after = time.perf_counter_ns(), time.time_ns(), time.perf_counter_ns()
            readings.append((after - before, utc - (before + after) // 2))
        self._origin = min(readings)[1]

    def now(self) -> int:
        """Time [ns] since 1970, never stepping back."""
        return self._origin + time.perf_counter_ns()

    def wait(self, seconds: float) -> None:
        """Lets time pass."""
        time.sleep(seconds)
