"""How an emulated Motive behaves: what its clock shows, and what goes wrong."""

from __future__ import annotations

from dataclasses import dataclass

from vrbench_optitrack.wire import Version

NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class ServerClock:
    """The server's clock, as ticks of the host's monotonic clock.

    Attributes:
        frequency: ticks a second by its own reckoning [Hz].
        skew_ppm: how much it gains on the host's.
        reference_ns: the host's monotonic time at which it shows `ticks`.
        ticks: what it shows then.
    """

    frequency: int
    skew_ppm: float
    reference_ns: int
    ticks: int

    def at(self, monotonic_ns: int) -> int:
        """What it shows at a monotonic time [ns]."""
        since = (monotonic_ns - self.reference_ns) * (1.0 + self.skew_ppm * 1e-6)
        return self.ticks + round(since * self.frequency / NS)


@dataclass(frozen=True, slots=True)
class Faults:
    """What goes wrong.

    Attributes:
        drop: chance that a frame never leaves.
        mute: answers, but sends no frames (Broadcast Frame Data off).
        stamps: which stamps frames carry: `mid`, `received`, `transmit` (and those after), `none`.
        claim: the version SERVERINFO says, where another is streamed.
        new_id_after_s: the body gets another streaming id, and the model list changes.
        switch_after_s: the bitstream changes to `switch_to`.
        switch_to: the version it changes to.
        step_after_s: the server's clock steps, as where Motive's computer was started anew.
        step_s: by so much [s].
    """

    drop: float = 0.0
    mute: bool = False
    stamps: str = "mid"
    claim: Version | None = None
    new_id_after_s: float | None = None
    switch_after_s: float | None = None
    switch_to: Version | None = None
    step_after_s: float | None = None
    step_s: float = 0.0
