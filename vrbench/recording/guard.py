"""What a recording keeps an eye on besides its devices: the host's clock and the disk's room."""

from __future__ import annotations

import shutil
from pathlib import Path

from vrbench.devices.ports import HostClock
from vrbench.errors import VrbenchError
from vrbench.streams import Columns, Event
from vrbench.trajectory import NS

LOOK_NS = NS
# NTP slews a clock by half a millisecond a second at most; more is a step.
STEP_NS = 20_000_000
# What is left free, so that takes and the run's record can still be closed in order.
LEAST_FREE = 32_000_000


class DiskFullError(VrbenchError):
    """There is no room to go on recording; exit code 1."""

    exit_code = 1


def disk_full(place: Path) -> DiskFullError:
    """Says what to do where the disk that `place` is on is full."""
    return DiskFullError("the disk is full", file=place, fix="make room, then go on with --resume")


class HostWatch:
    """Reads the host's clock beside UTC once a second: an NTP step is told, and bends no stamp."""

    def __init__(self, host: HostClock) -> None:
        self._host = host
        self._looked: int | None = None
        self._ahead: int | None = None

    def look(self, *, now: bool = False) -> Columns:
        """What is to be written: a reading where one is due, an event where UTC was stepped."""
        if not now and self._looked is not None and self._host.now() - self._looked < LOOK_NS:
            return Columns({})
        reading = self._host.reading()
        if reading is None:
            return Columns({})
        before, self._looked = self._looked, int(reading.received[0])
        ahead = int(reading.remote_sent[0] - (reading.sent[0] + reading.received[0]) // 2)
        step = 0 if self._ahead is None else ahead - self._ahead
        self._ahead = ahead
        events = []
        # a reading that the scheduler held up knows its moment no better than that
        held_up = int(reading.received[0] - reading.sent[0])
        if before is not None and abs(step) > STEP_NS + held_up:
            told = {"seconds": round(step / NS, 6), "after": before}
            events.append(Event(self._looked, "host-clock-step", told))
        return Columns({}, events=events, clocks={"host": reading})


class DiskWatch:
    """Looks once a second whether there is room left."""

    def __init__(self, place: Path, host: HostClock) -> None:
        self._place, self._host = place, host
        self._looked: int | None = None

    def look(self) -> None:
        """Looks, where it is time.

        Raises:
            DiskFullError: there is hardly any room left.
        """
        now = self._host.now()
        if self._looked is not None and now - self._looked < LOOK_NS:
            return
        self._looked = now
        if shutil.disk_usage(self._place).free < LEAST_FREE:
            raise disk_full(self._place)
