import numpy as np
import pytest

from vrbench.metrics import coverage
from vrbench.streams import GOOD, Flag


def test_missing_samples_and_bad_samples_both_cost_coverage(values, make_take):
    whole = values(coverage.FAMILY, make_take())["coverage.valid", "", "all", "value"]
    assert whole.value == pytest.approx(100)
    lost = values(coverage.FAMILY, make_take(keep=lambda s: (s < 5) | (s > 10)))
    assert lost["coverage.valid", "", "all", "value"].value == pytest.approx(75, abs=0.2)
    bad = values(
        coverage.FAMILY,
        make_take(flags=lambda s: np.where((s < 5) | (s > 10), GOOD, int(Flag.POSITION_VALID))),
    )
    assert bad["coverage.valid", "", "all", "value"].value == pytest.approx(75, abs=0.2)
    assert bad["coverage.completion", "", "all", "value"].value == 100


def test_every_other_sample_missing_for_a_while_costs_half_of_it(values, make_take):
    def keep(s):
        return (s < 5) | (np.arange(len(s)) % 2 == 0) | (s > 10)

    found = values(coverage.FAMILY, make_take(keep=keep))
    assert found["coverage.valid", "", "all", "value"].value == pytest.approx(87.5, abs=0.2)


@pytest.mark.parametrize(("gone", "left"), [((), 100.0), (range(5000, 5600), 97.0)])
def test_jitter_of_a_third_of_a_period_is_no_missing_sample(gone, left):
    """1000 Hz, stamped to 0.3 ms."""
    even = 1e6 * np.arange(20_000)
    t = np.sort(even + np.random.default_rng(2).normal(0.0, 0.3e6, len(even))).astype(np.int64)
    good = np.delete(t, list(gone))
    covered = coverage.covered_ns(good, int(t[0]), int(t[-1]), 1e6)
    assert 100.0 * covered / (t[-1] - t[0]) == pytest.approx(left, abs=0.1)


def test_every_tenth_sample_missing_is_seen_where_stamps_are_even():
    even = np.arange(0, 20_000_000_000, 10_000_000)
    covered = coverage.covered_ns(even[np.arange(2000) % 10 > 0], 0, int(even[-1]), 1e7)
    assert covered / even[-1] == pytest.approx(0.9, abs=0.002)


def test_completion_ends_with_the_last_good_sample(values, make_take):
    found = values(coverage.FAMILY, make_take(keep=lambda s: s < 15))
    assert found["coverage.completion", "", "all", "value"].value == pytest.approx(75, abs=0.2)
    nothing = make_take(flags=lambda s: np.zeros(len(s)))
    assert values(coverage.FAMILY, nothing)["coverage.valid", "", "all", "value"].value == 0
