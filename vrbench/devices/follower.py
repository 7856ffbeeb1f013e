"""A device's clock, followed while it is asked for its time: offsets, drift, and steps.

Each answered ping bounds the offset between two clocks from both sides. Frames are mapped to the
recorder's clock only when a ping before and a ping after them agree; between two that don't, the
headset's clock stepped (or stood still while it slept), and nobody knows the times of those frames.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vrbench.clocks import ClockMap, Exchanges, fit_exchanges
from vrbench.geometry import Ints
from vrbench.trajectory import NS

WINDOW_NS = 120 * NS
# Bounds hold for all time, but quartz drifts: those of the last seconds are compared.
BOUNDS_NS = 10 * NS
DRIFT = 200e-6
SLACK_NS = 2_000_000
FIRST_KNOT = 5
KNOT_EVERY_NS = NS // 4
# A slower answer says little of the clock, unless all are slow.
QUICK_NS = 100_000_000


@dataclass(frozen=True, slots=True)
class Answer:
    """One ping and its answer: NTP's four stamps [ns]."""

    sent: int
    remote_received: int
    remote_sent: int
    received: int

    @property
    def round_trip(self) -> int:
        """Time on the wire, both ways [ns]."""
        return (self.received - self.sent) - (self.remote_sent - self.remote_received)

    @property
    def bounds(self) -> tuple[int, int]:
        """The least and the most that the device's clock can be ahead [ns]."""
        return self.remote_sent - self.received, self.remote_received - self.sent


class DeviceClock:
    """Follows one clock until it steps."""

    def __init__(self) -> None:
        self._answers: deque[Answer] = deque()
        self._knots: list[tuple[int, float]] = []
        self.bound_ns = 0.0

    @property
    def until(self) -> int | None:
        """The device time [ns] up to which frames can be mapped; None before the first knot."""
        return self._knots[-1][0] if self._knots else None

    @property
    def since(self) -> int | None:
        """The device time [ns] of the first knot."""
        return self._knots[0][0] if self._knots else None

    def add(self, answer: Answer, *, at_once: bool = False) -> bool:
        """Takes an answer in; False where it can't be of the clock followed so far.

        With `at_once`, frames can be mapped up to this answer, however soon it follows the last.
        """
        if answer.remote_sent < answer.remote_received or answer.round_trip < -SLACK_NS:
            return False
        if self._answers and answer.remote_received < self._answers[-1].remote_sent:
            return False
        least, most = self._bounds(answer)
        if least > most + SLACK_NS:
            return False
        self._answers.append(answer)
        while answer.received - self._answers[0].received > WINDOW_NS:
            self._answers.popleft()
        self.bound_ns = max(0.0, (most - least) / 2)
        quick = max(QUICK_NS, 2 * float(np.median([x.round_trip for x in self._answers])))
        if len(self._answers) >= FIRST_KNOT and answer.round_trip <= quick:
            at = answer.remote_received
            if not self._knots or at - self._knots[-1][0] >= (1 if at_once else KNOT_EVERY_NS):
                self._set_knot(at, least, most)
        return True

    def to_host(self, t_device: Ints) -> Ints:
        """Device times (n,) [ns] on the recorder's clock."""
        knots = np.array([t for t, _ in self._knots], dtype=np.int64)
        offsets = np.array([offset for _, offset in self._knots])
        return ClockMap(knots, offsets).to_reference(t_device)

    def _bounds(self, answer: Answer) -> tuple[float, float]:
        """What this answer and those of the last seconds allow the offset to be [ns]."""
        least, most = map(float, answer.bounds)
        for earlier in reversed(self._answers):
            age = answer.received - earlier.received
            if age > BOUNDS_NS and earlier is not self._answers[-1]:
                break
            low, high = earlier.bounds
            least, most = max(least, low - DRIFT * age), min(most, high + DRIFT * age)
        return least, most

    def _set_knot(self, at: int, least: float, most: float) -> None:
        sound = [x for x in self._answers if x.round_trip >= 0]  # a browser rounds its stamps
        fit = fit_exchanges(exchanges_of(sound)) if sound else None
        offset = (least + most) / 2 if fit is None else float(fit.clock.offset_ns(at))
        # the quickest answers may all have been delayed on one way; bounds know better
        self._knots.append((at, min(max(offset, least), max(least, most))))
        # Only what frames may still fall between is needed; two hours would be 28 800 knots.
        if len(self._knots) > 600:
            del self._knots[:300]


def exchanges_of(answers: Sequence[Answer]) -> Exchanges:
    """Answers as columns."""
    return Exchanges(
        sent=np.array([x.sent for x in answers], dtype=np.int64),
        remote_received=np.array([x.remote_received for x in answers], dtype=np.int64),
        remote_sent=np.array([x.remote_sent for x in answers], dtype=np.int64),
        received=np.array([x.received for x in answers], dtype=np.int64),
    )
