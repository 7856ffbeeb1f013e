import numpy as np
import pytest

from vrbench.errors import EstimationError
from vrbench.estimation.peaks import peak_offset
from vrbench.geometry import Transform
from vrbench.trajectory import NS, Trajectory


def hill(at_s: list[float], rate_hz: float = 30.0) -> Trajectory:
    s = np.arange(0.0, 60.0, 1.0 / rate_hz)
    z = sum((0.2 * np.exp(-((s - a) ** 2)) for a in at_s), np.zeros_like(s))
    p = np.stack((0 * s, 0 * s, z + 0.5), axis=1)
    q = np.tile([0.0, 0.0, 0.0, 1.0], (len(s), 1))
    return Trajectory(np.rint(s * NS).astype(np.int64), Transform(p, q))


def test_the_offset_is_the_mean_difference_of_paired_peaks():
    found = peak_offset(hill([10.0, 30.0]), hill([10.4, 30.6]))
    assert found.offset_s == pytest.approx(0.5, abs=0.02)
    assert len(found.first) == len(found.second) == 2


def test_other_numbers_of_peaks_are_refused():
    with pytest.raises(EstimationError, match=r"2 peaks of 0\.095 m against 1"):
        peak_offset(hill([10.0, 30.0]), hill([10.4]))
    with pytest.raises(EstimationError, match="0 peaks"):
        peak_offset(hill([]), hill([]))


def test_the_papers_robot_runs_are_paired(recordings):
    for run, peaks in (("calib", 2), ("traj1", 3)):
        found = peak_offset(recordings["quest2", run].tcp, recordings["quest_pro", run].tcp)
        assert len(found.first) == peaks
        assert np.ptp(found.second - found.first) < 0.04 * NS


def test_peaks_fail_where_the_headset_sees_others(recordings):
    take = recordings["quest2", "traj1"]
    with pytest.raises(EstimationError, match="peaks"):
        peak_offset(take.tcp, take.eye)
