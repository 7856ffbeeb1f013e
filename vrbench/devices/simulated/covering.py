"""When which share of a headset's cameras is covered."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from vrbench.geometry import Bools, Floats, Ints
from vrbench.trajectory import NS

ALL = 1.0


class Covering:
    """The share of a headset's cameras that is covered, over time; none at first."""

    def __init__(self) -> None:
        self._steps: list[tuple[int, float]] = [(0, 0.0)]

    def cover(self, t: int, share: float) -> None:
        """From t [ns] on, this share of them is covered."""
        self._steps.append((t, share))

    def share(self, t: Ints) -> Floats:
        """The share (m,) at times t (m,) [ns]."""
        since, shares = zip(*self._steps, strict=True)
        found: Floats = np.array(shares)[np.searchsorted(since, t, side="right") - 1]
        return found

    def found_again(self) -> Ints:
        """When cameras saw again after all had been covered (k,) [ns]."""
        steps = pairwise(self._steps)
        return np.array([at for (_, a), (at, b) in steps if a == ALL != b], dtype=np.int64)

    def blind(self, t: Ints, relocalisation_s: float) -> tuple[Bools, Ints]:
        """Whether its position isn't tracked (m,), and how often it was found again before (m,).

        Args:
            t: times (m,) [ns].
            relocalisation_s: how long it takes to find its position again [s].
        """
        found = self.found_again()
        times = np.searchsorted(found, t, side="right")
        searching = np.zeros(len(t), dtype=np.bool_)
        if len(found):
            ago = t - found[np.maximum(times - 1, 0)]
            searching = (times > 0) & (ago < relocalisation_s * NS)
        return searching | (self.share(t) == ALL), times
