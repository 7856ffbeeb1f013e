"""Intervals of relative errors and of the scale hold, with X known and with X redrawn."""

from dataclasses import replace

import numpy as np
import pytest

from tests.statistics.test_uncertainty import scored
from vrbench.metrics import rpe
from vrbench.statistics.of_scale import scale_intervals
from vrbench.statistics.relative import relative_models
from vrbench.statistics.uncertainty import intervals, translation_errors

KEY = ("rpe.translation@1s", "eye")
TAKES = [scored(seed, 1.01, 2e-3) for seed in range(16)]
UNSURE = np.diag([1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3]) ** 2


def test_models_have_the_rows_mean_squares():
    models = relative_models(TAKES[0])
    rows = {(v.metric, v.point): v.value for v in rpe.of_take(TAKES[0]) if v.statistic == "rmse"}
    assert set(models) == set(rows)
    for key, model in models.items():
        assert np.sqrt(model.constant.mean()) == pytest.approx(rows[key], rel=0.02, abs=1e-6), key


def test_a_time_of_which_the_take_has_few_has_no_interval():
    t = TAKES[0].estimate
    short = replace(TAKES[0], estimate=t[: 30 * 60], truth=TAKES[0].truth[: 30 * 60])
    assert {metric for metric, _ in relative_models(short)} == {
        f"rpe.{kind}@{delta}s" for kind in ("translation", "rotation") for delta in ("0.1", "1")
    }


def rmse_interval(take, covariance=None):
    models = relative_models(take)
    found = intervals([models], [covariance], [("s", "m")], np.random.default_rng(1))
    return found[*KEY, "rmse"]


def test_intervals_of_relative_errors_hold_beside_an_error_of_scale():
    true = np.sqrt(np.mean([relative_models(take)[KEY].constant.mean() for take in TAKES]))
    ends = [rmse_interval(take) for take in TAKES]
    assert np.mean([end.low <= true <= end.high for end in ends]) >= 0.8
    assert np.mean([end.high - end.low for end in ends]) < 0.1 * true
    wide = rmse_interval(TAKES[0], UNSURE)
    assert wide.high - wide.low > ends[0].high - ends[0].low


def scale_interval(take, point, covariance):
    return scale_intervals(take, translation_errors(take), covariance)["scale", point, "value"]


@pytest.mark.parametrize("noise_m", [2e-3, 2e-4])
def test_intervals_of_the_scale_hold(noise_m):
    takes = [scored(seed, 1.01, noise_m) for seed in range(16)]
    ends = [
        scale_intervals(take, translation_errors(take), None)["scale", "eye", "value"]
        for take in takes
    ]
    assert np.mean([end.low <= 1 / 1.01 <= end.high for end in ends]) >= 0.8
    assert all(end.high - end.low < 0.8 * noise_m for end in ends)


def test_an_unsure_x_makes_the_scale_at_the_tcp_unsure():
    sure, unsure = (scale_interval(TAKES[0], "tcp", c) for c in (None, UNSURE))
    assert unsure.high - unsure.low > sure.high - sure.low
