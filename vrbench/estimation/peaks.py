"""The paper's way to an offset: peaks of the height of two motions, paired. For comparison only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vrbench.errors import EstimationError
from vrbench.estimation.checks import require_poses
from vrbench.geometry import Floats, Ints
from vrbench.trajectory import NS, Trajectory

HEIGHT_M = 0.095
DISTANCE = 300


@dataclass(frozen=True, slots=True, eq=False)
class PeakFit:
    """Peaks of two motions in pairs.

    Attributes:
        offset_s: the mean over the pairs of the second's time minus the first's [s].
        first: times of the first's peaks (k,) [ns].
        second: times of the second's peaks (k,) [ns].
    """

    offset_s: float
    first: Ints
    second: Ints


def peak_offset(
    first: Trajectory,
    second: Trajectory,
    *,
    height_m: float = HEIGHT_M,
    distance: int = DISTANCE,
) -> PeakFit:
    """The offset by peaks of z, relative to the first sample (Banaszczyk et al., 2024).

    Both are the tcp, in frames whose z axes agree. The k-th peak of one is paired with the k-th
    of the other.

    Args:
        first: the stream whose clock counts.
        second: the stream to be shifted onto it.
        height_m: the least height of a peak [m].
        distance: the least distance of two peaks in samples.

    Raises:
        EstimationError: values not finite, no peaks, or more in one stream than in the other.
    """
    peaks = [
        _peaks(trajectory, name, height_m, distance)
        for name, trajectory in (("first", first), ("second", second))
    ]
    if len(peaks[0]) != len(peaks[1]) or len(peaks[0]) == 0:
        raise EstimationError(
            f"{len(peaks[0])} peaks of {height_m:g} m against {len(peaks[1])}",
            fix="estimate the clock by angular speed instead",
        )
    offset = float(np.mean(peaks[1] - peaks[0])) / NS
    return PeakFit(offset, peaks[0], peaks[1])


def _peaks(trajectory: Trajectory, name: str, height_m: float, distance: int) -> Ints:
    """Times (k,) [ns] of the peaks."""
    from scipy.signal import find_peaks

    require_poses(trajectory, name, 3)
    z: Floats = trajectory.pose.p[:, 2] - trajectory.pose.p[0, 2]
    return trajectory.t[find_peaks(z, height=height_m, distance=distance)[0]]
