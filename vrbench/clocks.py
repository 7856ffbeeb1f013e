"""Maps from one clock to another: piecewise affine, in int64 nanoseconds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

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
        knots = np.array([at_ns, at_ns + NS], dtype=np.int64)
        return cls(knots, np.array([offset_s, offset_s + skew]) * NS)

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
