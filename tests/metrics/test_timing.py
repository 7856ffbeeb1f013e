import numpy as np
import pytest

from vrbench.metrics import timing


def test_timing_counts_repeats_and_measures_intervals(values, make_take):
    take = make_take(10.0, rate=50.0)
    again = np.sort(np.concatenate((np.arange(len(take.samples)), [10, 20, 20])))
    found = values(timing.FAMILY, make_take(10.0, rate=50.0, samples=take.samples[again]))
    assert found["timing.rate", "", "all", "value"].value == pytest.approx(50)
    assert found["timing.interval", "", "all", "median"].value == pytest.approx(20)
    assert found["timing.duplicates", "", "all", "count"].value == 3
