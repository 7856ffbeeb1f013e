"""What is exported of a take: one world frame of it, as it was scored."""

from __future__ import annotations

import re
from dataclasses import dataclass

from vrbench.metrics.scored import ScoredTake


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A stretch of a take in one world frame, ready as the metrics take it.

    Attributes:
        device: the headset's name.
        take: the take's name.
        reference: what it is scored against.
        scored: the take made ready.
    """

    device: str
    take: str
    reference: str
    scored: ScoredTake

    @property
    def stem(self) -> str:
        """How its files begin: take and reference, and the epoch where there are several."""
        segment = self.scored.segment
        epoch = "" if segment == "all" else "." + segment.replace(":", "")
        return plain(f"{self.take}.{self.reference}{epoch}")


def plain(name: str) -> str:
    """A name that is safe as a file's: what a bundle says may hold anything."""
    return re.sub(r"[^\w .-]", "_", name).lstrip(".")
