import numpy as np
import pytest

from vrbench.errors import EstimationError
from vrbench.statistics.paired import by_phase, paired_difference


def run(rng, scale, hardness, mounts=2, repeats=3):
    """Repeats whose errors grow with how hard each second of the motion is."""
    phase = np.arange(0, len(hardness), 0.02)
    sigma = scale * hardness[phase.astype(int)]
    return [
        by_phase(phase, np.abs(rng.normal(0, sigma)), mount=str(m))
        for m in range(mounts)
        for _ in range(repeats)
    ]


def test_phases_hold_means_and_mean_squares():
    phases = by_phase(np.array([0.1, 0.9, 2.5]), np.array([1.0, 3.0, 2.0]))
    assert phases.bin.tolist() == [0, 2]
    assert phases.mean.tolist() == [2.0, 2.0]
    assert phases.mean_square.tolist() == [5.0, 4.0]


def test_a_small_difference_is_seen_though_the_motion_varies_much_more():
    rng = np.random.default_rng(0)
    hardness = rng.uniform(0.5, 3.0, 120)
    found = paired_difference(run(rng, 1.1, hardness), run(rng, 1.0, hardness), rng, replicates=300)
    assert found.value == pytest.approx(0.1 * np.sqrt(np.mean(hardness**2)), rel=0.2)
    assert found.low < found.value < found.high
    assert found.separable
    assert found.scope == "mount"
    assert found.bins == 120


def test_equal_runs_are_not_separable():
    rng = np.random.default_rng(1)
    hardness = rng.uniform(0.5, 3.0, 60)
    alarms = sum(
        paired_difference(
            run(rng, 1, hardness), run(rng, 1, hardness), rng, replicates=100
        ).separable
        for _ in range(20)
    )
    assert alarms <= 4


def test_single_takes_differ_but_nothing_follows():
    rng = np.random.default_rng(2)
    hardness = np.ones(60)
    first, second = run(rng, 2, hardness, 1, 1), run(rng, 1, hardness, 1, 1)
    found = paired_difference(first, second, rng, replicates=100)
    assert found.low > 0
    assert not found.separable
    assert "takes only" in found.reason


def test_runs_without_common_bins_are_refused():
    rng = np.random.default_rng(3)
    first = [by_phase(np.arange(0, 20, 0.1), np.ones(200))]
    second = [by_phase(np.arange(15, 35, 0.1), np.ones(200))]
    with pytest.raises(EstimationError, match="5 bins"):
        paired_difference(first, second, rng)
