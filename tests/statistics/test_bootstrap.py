import numpy as np
import pytest

from vrbench.errors import EstimationError
from vrbench.statistics.bootstrap import Series, bootstrap, draw_members, nested, scope_of


def ar1(rng, n, rho, scale=1.0):
    """A stationary AR(1) series (n,) of standard deviation `scale`."""
    step = rng.normal(0, scale * np.sqrt(1 - rho**2), n)
    x = np.empty(n)
    x[0] = rng.normal(0, scale)
    for i in range(1, n):
        x[i] = rho * x[i - 1] + step[i]
    return x


@pytest.mark.parametrize(("statistic", "truth"), [("rmse", 1.0), ("mean", 0.0)])
def test_intervals_of_correlated_errors_hold_about_as_often_as_they_say(statistic, truth):
    rng = np.random.default_rng(20)
    held = 0
    for _ in range(200):
        series = [Series(ar1(rng, 1500, 0.9))]
        interval = bootstrap(series, rng, statistic=statistic, replicates=200)
        held += interval.low <= truth <= interval.high
    assert held / 200 > 0.87


def test_intervals_that_took_samples_for_news_would_be_far_too_narrow():
    rng = np.random.default_rng(21)
    errors = ar1(rng, 4000, 0.98)
    interval = bootstrap([Series(errors)], rng, statistic="mean", replicates=400)
    naive = 2 * 1.96 * errors.std() / np.sqrt(len(errors))
    assert interval.high - interval.low > 3 * naive


def test_scatter_between_mounts_widens_the_interval():
    rng = np.random.default_rng(22)

    def width(levels):
        series = [
            Series(np.abs(rng.normal(level, 0.1, 500)), mount=str(m))
            for m, level in enumerate(levels)
            for _ in range(3)
        ]
        interval = bootstrap(series, rng, statistic="mean", replicates=300)
        assert interval.scope == "mount"
        return interval.high - interval.low

    assert width([1.0, 2.0, 3.0]) > 10 * width([2.0, 2.0, 2.0])


def test_redrawn_values_bring_their_uncertainty_in():
    rng = np.random.default_rng(23)
    errors = rng.normal(0, 1, 2000)
    series = [Series(errors)]
    alone = bootstrap(series, rng, statistic="mean", replicates=300)
    redrawn = bootstrap(
        series,
        rng,
        statistic="mean",
        replicates=300,
        redraw=lambda rng, count: [errors + rng.normal(0, 0.5, (count, 1))],
    )
    assert redrawn.high - redrawn.low == pytest.approx(2 * 1.96 * 0.5, rel=0.2)
    assert alone.high - alone.low < 0.15


def test_one_seed_gives_one_interval():
    series = [Series(np.random.default_rng(0).normal(size=300))]
    a, b = (bootstrap(series, np.random.default_rng(1), replicates=50) for _ in range(2))
    assert a == b


@pytest.mark.parametrize(
    ("places", "scope"),
    [
        ([("s", "m")] * 5, "take"),
        ([("s", "m1")] * 3 + [("s", "m2")] * 2, "take"),
        ([("s", "m1")] * 3 + [("s", "m2")] * 3, "mount"),
        ([("s1", "m")] * 3 + [("s2", "m")] * 3, "sitting"),
    ],
)
def test_an_interval_speaks_for_no_more_than_was_repeated(places, scope):
    assert scope_of(places) == scope


def test_members_are_drawn_within_their_groups():
    places = [("s", "a"), ("s", "a"), ("s", "b"), ("s", "b")]
    rng = np.random.default_rng(2)
    drawn = [draw_members(nested(places), rng) for _ in range(200)]
    assert all(len(d) == 4 for d in drawn)
    assert any({places[i][1] for i in d} == {"a"} for d in drawn)
    # The first two always come from one mount, and the last two too.
    assert all(places[d[0]] == places[d[1]] and places[d[2]] == places[d[3]] for d in drawn)


def test_nothing_has_no_interval():
    with pytest.raises(EstimationError):
        bootstrap([], np.random.default_rng(0))
    with pytest.raises(EstimationError):
        bootstrap([Series(np.zeros(0))], np.random.default_rng(0))
