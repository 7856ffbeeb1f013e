"""The server's ticks on the host's clock: the quickest echo of each second, over two minutes."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from vrbench.clocks import ExchangeFit, Exchanges, fit_exchanges
from vrbench.geometry import Ints
from vrbench.trajectory import NS

WINDOW = 120
SKEW_AFTER_S = 4.0
STEP_NS, DRIFT_PPM = 500_000, 200
"""What the map may err by, besides what its echoes' trips allow: at all, and since the last."""
SLOW, SLOW_NS = 2, 200_000
"""An echo slower than so many times the quickest, and so much more [ns], tells nothing."""
Echo = tuple[int, int, int]
"""When the request left [ns, host], the server's ticks, when the answer came [ns, host]."""


def ticks_to_ns(ticks: Ints, frequency: int) -> Ints:
    """Ticks (n,) as nanoseconds of the server's own clock, without loss of a tick."""
    return ticks // frequency * NS + ticks % frequency * NS // frequency


class TickClock:
    """Offset and skew of the server's clock, from its answers to echo requests.

    A second's quickest echo stands for that second, so that the window is covered evenly; a fit to
    the quick ones of the last two minutes maps ticks. One echo bounds the offset by half its round
    trip, whatever the network does.

    Args:
        frequency: ticks a second of the server's clock [Hz].

    Attributes:
        heard: when the newest request left that was answered as the map says [ns, host].
    """

    def __init__(self, frequency: int) -> None:
        self.frequency = frequency
        self.heard = 0
        self._kept: deque[Echo] = deque(maxlen=WINDOW)
        self._base = 0
        self._fit: ExchangeFit | None = None

    def __bool__(self) -> bool:
        """Whether any echo has come."""
        return bool(self._kept)

    def add(self, echo: Echo) -> bool:
        """Takes an echo in; False, and it isn't, where the server's clock has stepped."""
        if self._kept and not self._agrees(echo):
            return False
        self.heard = max(self.heard, echo[0])
        if self._kept and self._kept[-1][0] // NS == echo[0] // NS:
            if _trip(echo) >= _trip(self._kept[-1]):
                return True
            self._kept.pop()
        self._kept.append(echo)
        self._fit = None
        return True

    def kept(self) -> list[Echo]:
        """The echoes that the map rests on."""
        return list(self._kept)

    def fit(self) -> ExchangeFit:
        """The map's parameters; its device clock is `shifted` ticks."""
        if self._fit is None:
            first = self._kept[0]
            quick = [echo for echo in self._kept if _trip(echo) <= self._slowest()]
            # The two clocks may lie decades apart: floats would lose what counts.
            self._base = first[0] - int(ticks_to_ns(np.array([first[1]]), self.frequency)[0])
            self._fit = fit_exchanges(
                exchanges_of(quick, self.frequency, self._base),
                keep=1.0,
                skew_after_s=SKEW_AFTER_S,
            )
        return self._fit

    def to_host(self, ticks: Ints) -> Ints:
        """Ticks (n,) as host times [ns]."""
        fit = self.fit()
        return fit.clock.to_reference(ticks_to_ns(ticks, self.frequency) + self._base)

    @property
    def skew_ppm(self) -> float:
        """How much the server's clock gains on the host's [ppm]."""
        clock = self.fit().clock
        return float(np.diff(clock.offsets)[0] / np.diff(clock.knots)[0]) * 1e6

    def _agrees(self, echo: Echo) -> bool:
        sent, ticks, received = echo
        there = int(self.to_host(np.array([ticks]))[0])
        since = max(0, sent - self._kept[-1][2])
        slack = STEP_NS + self._slowest() // 2 + since * DRIFT_PPM // 1_000_000
        return sent - slack <= there <= received + slack

    def _slowest(self) -> int:
        """The longest trip of an echo that counts [ns]."""
        return SLOW * min(map(_trip, self._kept)) + SLOW_NS


def exchanges_of(echoes: Sequence[Echo], frequency: int, base: int = 0) -> Exchanges:
    """Echoes as clock exchanges, the server's time in nanoseconds of its own clock plus `base`."""
    sent, ticks, received = np.array(list(echoes), dtype=np.int64).reshape(-1, 3).T
    remote = ticks_to_ns(ticks, frequency) + base
    return Exchanges(sent, remote, remote, received)


def _trip(echo: Echo) -> int:
    return echo[2] - echo[0]
