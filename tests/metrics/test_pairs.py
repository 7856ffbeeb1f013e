import numpy as np
import pytest

from vrbench.errors import EstimationError
from vrbench.geometry import Transform
from vrbench.metrics.as_evo import Delta, pairs
from vrbench.metrics.pairs import pairs_by_time


def line(n):
    return Transform(np.outer(np.arange(n) * 0.5, [1.0, 0, 0]), np.tile([0.0, 0, 0, 1], (n, 1)))


def listed(pairs):
    return list(zip(*(x.tolist() for x in pairs), strict=True))


def test_frames_end_to_end_or_from_each():
    assert listed(pairs(line(6), None, Delta(2, "frames"))) == [(0, 2), (2, 4)]
    every = Delta(2, "frames", all_pairs=True)
    assert listed(pairs(line(5), None, every)) == [(0, 2), (1, 3), (2, 4)]


def test_one_pair_is_enough_and_none_is_an_error():
    assert listed(pairs(line(3), None, Delta(2, "frames"))) == [(0, 2)]
    for n in (0, 1, 2):
        for unit in ("frames", "m", "deg"):
            with pytest.raises(EstimationError, match="poses are 2"):
                pairs(line(n), None, Delta(2, unit))


def test_a_gap_in_time_has_no_pairs_across_it():
    t = np.array([0, 1, 2, 10, 11, 12], dtype=np.int64) * 100
    assert listed(pairs_by_time(t, 100, 10)) == [(0, 1), (1, 2), (3, 4), (4, 5)]
    assert listed(pairs_by_time(t, 500, 10)) == []
    assert listed(pairs_by_time(t[:0], 500, 10)) == []
