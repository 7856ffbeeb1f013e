"""Intervals by the scatter of takes: how often they hold what is true."""

import numpy as np
import pytest

from vrbench.statistics.of_takes import drawn_takes, interval_of_takes

FOUR_OF_THREE = [("1", str(mount)) for mount in range(4) for _ in range(3)]


def test_it_holds_the_rmse_of_events_that_come_once_a_take():
    """Offsets after a loss: normal on each axis, one a take; the rms length is the root of 3."""
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(60):
        offsets = np.linalg.norm(rng.normal(size=(12, 3)), axis=1)
        drawn = drawn_takes(FOUR_OF_THREE, rng)
        found = interval_of_takes(offsets, np.ones(12), drawn, FOUR_OF_THREE, "rmse")
        held += found.low <= np.sqrt(3.0) <= found.high
        assert found.scope == "mount"
    assert held >= 54  # nine in ten


def test_mounts_that_differ_widen_it():
    rng = np.random.default_rng(6)
    drawn = drawn_takes(FOUR_OF_THREE, rng)
    alike = np.tile([1.0, 1.1, 0.9], 4)
    apart = alike * np.repeat([0.5, 1.0, 1.5, 2.0], 3)
    narrow, wide = (
        interval_of_takes(values, np.ones(12), drawn, FOUR_OF_THREE, "rmse")
        for values in (alike, apart)
    )
    assert wide.high - wide.low > 5.0 * (narrow.high - narrow.low)


@pytest.mark.parametrize("statistic", ["rmse", "mean"])
def test_takes_weigh_what_they_rest_on(statistic):
    """A take of one sample among takes of a hundred hardly counts, wherever it lies."""
    rng = np.random.default_rng(7)
    values, samples = np.ones(12), np.full(12, 100.0)
    values[0], samples[0] = 10.0, 1.0
    drawn = drawn_takes(FOUR_OF_THREE, rng)
    found = interval_of_takes(values, samples, drawn, FOUR_OF_THREE, statistic)
    assert found.low == pytest.approx(1.0)
    assert found.high < 1.5
