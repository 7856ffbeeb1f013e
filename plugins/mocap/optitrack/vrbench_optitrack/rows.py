"""Frames that wait to be read, until their times can be told.

A frame waits for an answer to a clock request that shows that the clock hadn't stepped before it
came: where it has, nobody could tell by which of the two clocks the frame is stamped.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from vrbench.trajectory import NS
from vrbench_optitrack.clock import TickClock
from vrbench_optitrack.frame import UNSAID, VALID, BodyFrame, BodyRow

ROWS = 60_000
"""Frames that are held for `read`: a minute at 1000 Hz; older ones are dropped, and counted."""
HOLD_NS = NS
"""A frame waits so long at most for an answer that says its clock hasn't stepped."""
IN_FLIGHT_NS = NS // 10
"""A frame that comes so soon after a clock has stepped may have been taken before."""


class Row(NamedTuple):
    """A frame, as much of it as counts.

    Attributes:
        arrival: when it came [ns, host].
        number: of the frame.
        stamps: mid-exposure, data received, transmit [ticks]; 0 where not known.
        body: the wanted body; None where it isn't in the frame.
        valid: whether it is tracked.
        clock: what its stamps are of; None before any answer.
        sure: whether they are: not where that clock may have stepped by then.
    """

    arrival: int
    number: int
    stamps: tuple[int, int, int]
    body: BodyRow | None
    valid: bool
    clock: TickClock | None
    sure: bool


class Rows(deque[Row]):
    """Frames, oldest first; of too many the oldest are dropped, and counted.

    Attributes:
        lost: frames whose number never came.
        overflown: frames that were read too late.
        collecting: whether frames are taken in.
    """

    def __init__(self) -> None:
        super().__init__(maxlen=ROWS)
        self.lost = self.overflown = 0
        self.collecting = True
        self._last: Row | None = None
        self._doubt_until = 0

    def take_in(
        self, frame: BodyFrame, body_id: int | None, clock: TickClock | None, now: int
    ) -> int:
        """Takes a frame in that came at a host time [ns]; how many never came before it.

        Args:
            frame: the frame; one that comes twice counts once.
            body_id: of the wanted body.
            clock: what stamps are of, as far as that is known.
            now: when it came [ns, host].
        """
        last, missing = self._last, 0
        if last is not None:
            if frame.number == last.number:
                return 0
            # A number that goes back, or far ahead, is a recording that is played again.
            if 1 < frame.number - last.number < 100_000:
                missing = frame.number - last.number - 1
                self.lost += missing
        body = next((row for row in frame.bodies if row[0] == body_id), None)
        if body is None:
            valid = False
        elif body[9] == UNSAID:
            # 2.5 says nothing of tracking: a pose that repeats to the last bit was held.
            valid = last is None or last.body is None or last.body[1:8] != body[1:8]
        else:
            valid = bool(body[9] & VALID)
        sure = now >= self._doubt_until
        row = Row(now, frame.number, frame.suffix[4:7], body, valid, clock or None, sure)
        self._last = row
        if self.collecting:
            self.overflown += len(self) == ROWS
            self.append(row)
        return missing

    def doubt(self, since: int, now: int) -> None:
        """A clock has stepped: what came since, and what is on its way, may be stamped by either.

        Args:
            since: when the clock was known last [ns, host].
            now: when it was found to have stepped [ns, host].
        """
        doubted = []
        while self and self[-1].arrival > since:
            doubted.append(self.pop()._replace(sure=False))
        self.extend(reversed(doubted))
        self._doubt_until = now + IN_FLIGHT_NS

    def settled(self, now: int) -> list[Row]:
        """Takes out the frames whose times can be told, oldest first."""
        out = []
        while self and (not self.collecting or _is_settled(self[0], now)):
            out.append(self.popleft())
        return out


def _is_settled(row: Row, now: int) -> bool:
    if row.clock is None or not row.sure or not any(row.stamps):
        return True
    return row.arrival <= row.clock.heard or now - row.arrival > HOLD_NS
