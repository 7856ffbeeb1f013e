"""A take made ready for scoring: one clock, one window, reference and estimate in pairs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

from vrbench.clocks import ClockMap
from vrbench.geometry import Floats, Ints, Transform
from vrbench.streams import Columns, Event, Samples
from vrbench.trajectory import Trajectory


class ClockEvidence(Protocol):
    """What the fit of a clock says of itself; `vrbench.estimation.clock.ClockFit` does."""

    @property
    def residual_s(self) -> float | None:
        """RMS scatter of the offset about the fitted map [s]; None where it wasn't measured."""

    @property
    def local_t(self) -> Ints:
        """Middles (k,) [ns] of the windows whose offset was found, on the headset's clock."""

    @property
    def local_ns(self) -> Floats:
        """Their offsets (k,) [ns]."""


@dataclass(frozen=True, slots=True, eq=False)
class ScoredTake:
    """What the metrics of a take are computed from.

    All times are on the reference's clock [ns], within the scored window. The estimate lies in one
    epoch: a take with several is scored as several.

    Attributes:
        columns: the take as it was recorded, on its own clocks.
        reference: `T_base_tcp` in the window, at the reference's own rate.
        samples: every sample of the headset in the window, good or not.
        estimate: `T_world_eye`, the good samples for which there is a reference (n,).
        truth: the reference interpolated at the estimate's stamps, `T_base_tcp` (n,).
        clock: from the headset's clock to the reference's.
        x: `T_tcp_eye` of the mount's calibration; None without one.
        y: `T_base_world` fitted over the window; None without `x`.
        anchor_end: end of the anchor window [ns]; None where the case has none.
        sitting_y: `T_base_world` of the calibration, where nothing recentred in between.
        no_sitting: why there is none.
        segment: `all`, or the epoch it lies in.
        x_covariance: of X (6, 6): rotation vector in `eye` [rad], translation in `tcp` [m].
        offset_sigma_s: standard deviation of the clock's offset [s].
        recorder_behind_ns: what the recorder's clock lacks of the reference's; 0: they are one.
        clock_fit: what the fit of `clock` says of itself; None where the clocks were given.
    """

    columns: Columns
    reference: Trajectory
    samples: Samples
    estimate: Trajectory
    truth: Transform
    clock: ClockMap
    x: Transform | None = None
    y: Transform | None = None
    anchor_end: int | None = None
    sitting_y: Transform | None = None
    no_sitting: str = "no world frame of a calibration holds in this take"
    clock_fit: ClockEvidence | None = None
    segment: str = "all"
    x_covariance: Floats | None = None
    offset_sigma_s: float | None = None
    recorder_behind_ns: int = 0

    def events(self) -> Iterator[Event]:
        """What happened in the take, on the reference's clock, within the window or not."""
        for event in self.columns.events:
            yield replace(event, t=event.t + self.recorder_behind_ns)

    def points(self) -> Iterator[tuple[str, Transform, Transform]]:
        """(name, truth `T_base_point`, estimate `T_world_point`), at the eye and at the tcp.

        Raises:
            ValueError: the take has no `x`, without which neither point can be compared.
        """
        if self.x is None:
            raise ValueError("a take without x has no common point")
        yield "eye", self.truth @ self.x, self.estimate.pose
        yield "tcp", self.truth, self.estimate.pose @ self.x.inverse()

    def positions(self) -> Iterator[tuple[str, Floats, Floats]]:
        """The positions (n, 3) [m] of `points()` alone; raises as it does."""
        if self.x is None:
            raise ValueError("a take without x has no common point")
        yield "eye", self.truth.apply(self.x.p), self.estimate.pose.p
        yield "tcp", self.truth.p, self.estimate.pose.apply(self.x.inverse().p)
