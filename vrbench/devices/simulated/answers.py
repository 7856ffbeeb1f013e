"""A simulated device that answers pings: exchanges with delays, and the clock fitted to them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vrbench.clocks import ClockMap, Exchanges, fit_exchanges
from vrbench.geometry import Ints
from vrbench.trajectory import NS

EVERY_S = 0.25
# Wi-Fi in one room: half a millisecond each way, and a tail.
DELAY_S = 0.0005
TAIL_S = 0.001
WINDOW = round(120.0 / EVERY_S)
# As many answers before the first sample, as a live route has when recording starts.
AHEAD = 80


class Answers:
    """Pings every quarter of a second from `start_ns` on, whenever they are asked for.

    Args:
        rng: of the delays.
        start_ns: first ping, host clock [ns].
        device: from host times (n,) [ns] to the device's (n,) [ns].
    """

    def __init__(
        self, rng: np.random.Generator, start_ns: int, device: Callable[[Ints], Ints]
    ) -> None:
        self._rng, self._start, self._device = rng, start_ns, device
        self._all: Exchanges | None = None
        self._next = -AHEAD
        self._knots: list[int] = []
        self._offsets: list[float] = []

    def until(self, host_ns: int) -> Exchanges:
        """The exchanges that ended by now and weren't given before."""
        last = int((host_ns - self._start) // (EVERY_S * NS)) + 1
        index = np.arange(self._next, max(self._next, last))
        sent = self._start + np.rint(index * EVERY_S * NS).astype(np.int64)
        there, back = (
            np.rint((DELAY_S + self._rng.exponential(TAIL_S, (len(index), 2))) * NS)
            .astype(np.int64)
            .T
        )
        remote = self._device(sent + there)
        new = Exchanges(sent, remote, remote, sent + there + back)
        self._next += len(index)
        self._all = new if self._all is None else Exchanges.concatenate((self._all, new))
        self._follow()
        return new

    def clock(self) -> ClockMap:
        """From the device's clock to the host's, followed through the answers so far."""
        return ClockMap(np.array(self._knots, dtype=np.int64), np.array(self._offsets))

    def _follow(self) -> None:
        """A knot for every answer, each fitted to the two minutes before it, as live routes do."""
        assert self._all is not None
        a = self._all
        for end in range(AHEAD + len(self._knots), len(a)):
            part = slice(max(0, end + 1 - WINDOW), end + 1)
            window = Exchanges(
                a.sent[part], a.remote_received[part], a.remote_sent[part], a.received[part]
            )
            at = int(a.remote_received[end])
            self._knots.append(at)
            self._offsets.append(float(fit_exchanges(window).clock.offset_ns(at)))
