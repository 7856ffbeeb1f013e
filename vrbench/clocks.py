"""Maps from one clock to another, and their fit to a device's answers; int64 nanoseconds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Ints
from vrbench.trajectory import NS


@dataclass(frozen=True, slots=True, eq=False)
class ClockMap:
    """From a device's clock to the reference's: `t_reference = t_device - offset(t_device)`.

    The offset is the device's clock minus the reference's. It is linear between knots and
    continues with the slope of the outer pieces; one knot is a constant offset.

    Attributes:
        knots: times on the device's clock (k,) [ns], increasing.
        offsets: offsets at the knots (k,) [ns], float.
    """

    knots: Ints
    offsets: Floats

    @classmethod
    def affine(cls, at_ns: int, offset_s: float, skew: float = 0.0) -> ClockMap:
        """The offset [s] at one device time [ns], growing by `skew` seconds a second."""
        # The knots are far apart because an offset of epoch size is known to 256 ns in float64,
        # and that error over the distance is an error of the skew.
        apart_s = 10_000
        knots = np.array([at_ns, at_ns + apart_s * NS], dtype=np.int64)
        return cls(knots, np.array([offset_s, offset_s + skew * apart_s]) * NS)

    def offset_ns(self, t_device: npt.ArrayLike) -> Floats:
        """Offsets [ns] at times on the device's clock [ns]."""
        t = np.asarray(t_device, dtype=np.int64)
        if len(self.knots) == 1:
            return np.full(t.shape, self.offsets[0])
        piece = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.knots) - 2)
        slope = np.diff(self.offsets) / np.diff(self.knots)
        offsets: Floats = self.offsets[piece] + slope[piece] * (t - self.knots[piece])
        return offsets

    def to_reference(self, t_device: Ints) -> Ints:
        """Device times [ns] as times on the reference's clock [ns]."""
        return t_device - np.rint(self.offset_ns(t_device)).astype(np.int64)


def device_time(clock: ClockMap, t_reference: int) -> int:
    """The device's time [ns] at a time of the reference [ns]."""
    t = t_reference
    # Skews are parts per million, so each round gains five digits.
    for _ in range(3):
        t = t_reference + round(float(clock.offset_ns(t)))
    return t


@dataclass(frozen=True, slots=True)
class Skew:
    """How much a device's clock gains on the reference's, by other takes.

    Attributes:
        value: [s/s].
        sigma: its standard deviation [s/s].
    """

    value: float
    sigma: float


@dataclass(frozen=True, slots=True, eq=False)
class Exchanges:
    """Requests that a device answered with its own time, as NTP's four stamps.

    Attributes:
        sent: when the request left (n,) [ns], host clock.
        remote_received: when it came in (n,) [ns], device clock.
        remote_sent: when the answer left (n,) [ns], device clock; the same where it gives one time.
        received: when the answer came in (n,) [ns], host clock.
    """

    sent: Ints
    remote_received: Ints
    remote_sent: Ints
    received: Ints

    @classmethod
    def concatenate(cls, parts: Sequence[Exchanges]) -> Exchanges:
        return cls(
            sent=np.concatenate([x.sent for x in parts]),
            remote_received=np.concatenate([x.remote_received for x in parts]),
            remote_sent=np.concatenate([x.remote_sent for x in parts]),
            received=np.concatenate([x.received for x in parts]),
        )

    def __len__(self) -> int:
        return len(self.sent)

    @property
    def round_trip(self) -> Ints:
        """Time on the wire, both ways (n,) [ns]."""
        return (self.received - self.sent) - (self.remote_sent - self.remote_received)


FLOOR_NS = 5_000.0
"""How well the ends of an exchange are stamped at best, on any host."""


@dataclass(frozen=True, slots=True, eq=False)
class ExchangeFit:
    """A device's clock, from exchanges.

    Attributes:
        clock: from the device's clock to the host's.
        bound_s: how wrong the offset can be at most, half the least round trip [s].
        residual_s: root mean square about the fit of the exchanges used [s].
        used: how many exchanges were used.
    """

    clock: ClockMap
    bound_s: float
    residual_s: float
    used: int


def fit_exchanges(
    exchanges: Exchanges, *, keep: float = 0.3, skew_after_s: float = 60.0
) -> ExchangeFit:
    """Offset and skew from the exchanges with the least round trips.

    A slow answer was delayed on one way, and nobody knows on which; so only the quickest `keep` of
    the exchanges count (Mills, RFC 5905), each by how little it can err. The skew is fitted where
    they span `skew_after_s` or more, and is zero before.

    Raises:
        EstimationError: no exchange, or a round trip that is negative.
    """
    if not len(exchanges):
        raise EstimationError("no clock exchange was answered")
    trip = exchanges.round_trip
    if np.any(trip < 0):
        raise EstimationError("an answer came before its request: a clock stepped")
    best = np.sort(np.argsort(trip, kind="stable")[: max(1, math.ceil(keep * len(trip)))])
    # Differences of int64 first: sums of epoch nanoseconds would overflow, floats lose digits.
    there = exchanges.remote_received[best] - exchanges.sent[best]
    back = exchanges.remote_sent[best] - exchanges.received[best]
    offset = there / 2 + back / 2
    at = exchanges.remote_received[best]
    middle = int(at[len(at) // 2])
    since = (at - middle) / NS
    # An answer late by e errs by up to e / 2; the floor is what scheduling makes uncertain anyway.
    weight = 1.0 / (FLOOR_NS + (trip[best] - trip.min()) / 2)
    if len(best) >= 3 and since[-1] - since[0] >= skew_after_s:
        level, slope = np.polynomial.polynomial.polyfit(since, offset - offset[0], 1, w=weight)
        level += offset[0]
    else:
        slope, level = 0.0, float(offset[0] + np.average(offset - offset[0], weights=weight**2))
    residual = offset - (level + slope * since)
    return ExchangeFit(
        clock=ClockMap.affine(middle, float(level) / NS, float(slope) / NS),
        bound_s=float(trip.min()) / 2 / NS,
        residual_s=float(np.sqrt(np.mean(residual**2))) / NS,
        used=len(best),
    )
