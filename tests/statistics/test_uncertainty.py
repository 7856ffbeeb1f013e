from dataclasses import replace

import numpy as np
import pytest

from vrbench.clocks import ClockMap
from vrbench.estimation.blocks import block_length
from vrbench.geometry import Transform, rotvec_to_quat
from vrbench.metrics.scored import ScoredTake
from vrbench.statistics.uncertainty import (
    ErrorModel,
    error_models,
    intervals,
    offset_interval,
    translation_errors,
)
from vrbench.streams import Columns, Samples
from vrbench.trajectory import NS, Trajectory

KEY = ("ape.translation.aligned", "eye")


def model(turn: float | None = None, **options) -> ErrorModel:
    """An error of 0.1 in each of 50 bins, whatever X is."""
    flat = np.full(50, 0.01)
    return ErrorModel(flat, np.zeros((50, 6)), np.zeros((50, 6, 6)), 0.0 * flat, 1, turn, **options)


def drawn(one: ErrorModel, seed: int = 0) -> np.ndarray:
    return one.drawn(np.zeros((20_000, 6)), np.random.default_rng(seed))[:, 0]


def test_an_alignment_adds_what_it_does_in_the_mean_and_not_what_it_did():
    assert drawn(model(0.002, turned=0.003)) == pytest.approx(0.009)


def test_a_turn_known_from_few_blocks_widens():
    few, many = (np.ptp(np.percentile(drawn(model(0.002, freedom=n)), (5, 95))) for n in (6, 600))
    assert few > 5.0 * many


def test_x_redrawn_widens_and_does_not_move():
    flat = np.full(50, 0.01)
    by_x = np.zeros((50, 6)), np.broadcast_to(np.eye(6), (50, 6, 6))
    dx = np.random.default_rng(2).normal(0.0, 0.05, (500, 6))
    found = ErrorModel(flat, *by_x, 0.0 * flat, 1).drawn(dx, np.random.default_rng(0))
    assert found.mean() == pytest.approx(0.01)
    assert found.std() > 0.005


def test_an_error_that_is_aligned_itself_is_taken_as_it_is():
    assert np.array_equal(drawn(model()), np.full(20_000, 0.01))


def scored(seed: int, scale: float, noise_m: float, offset_sigma_s: float | None = None):
    """A take of 100 s whose motion is large at times, with white noise and an error of scale."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 100 * NS, NS // 30)
    s = t / NS
    size = 0.2 * np.abs(np.sin(0.11 * s))
    p = size[:, None] * np.stack([np.sin(1.3 * s), np.cos(0.9 * s), np.sin(0.5 * s)], 1)
    q = rotvec_to_quat(0.3 * np.stack([np.sin(s), np.cos(0.7 * s), np.sin(0.4 * s)], 1))
    truth = Transform(p, q)
    eye = Transform(scale * p + rng.normal(0.0, noise_m, p.shape), q)
    return ScoredTake(
        columns=Columns({}),
        reference=Trajectory(t, truth),
        samples=Samples.of(t, eye),
        estimate=Trajectory(t, eye),
        truth=truth,
        clock=ClockMap.affine(0, 0.25),
        x=Transform.identity(),
        offset_sigma_s=offset_sigma_s,
    )


def rmse_interval(model: ErrorModel):
    found = intervals([{KEY: model}], [None], [("s", "m")], np.random.default_rng(1))
    return found[*KEY, "rmse"]


def width(model: ErrorModel) -> float:
    interval = rmse_interval(model)
    return interval.high - interval.low


def test_an_error_of_scale_alone_is_no_chance_of_the_take():
    """The same motion has it again: quiet stretches don't make its rmse uncertain."""
    take = scored(0, 1.01, 1e-6)
    found = error_models(take, translation_errors(take))[KEY]
    assert width(found) < 0.01 * np.sqrt(found.constant.mean())


def test_intervals_of_rmse_hold_beside_an_error_of_scale():
    takes = [scored(seed, 1.01, 2e-3) for seed in range(16)]
    found = [error_models(take, translation_errors(take))[KEY] for take in takes]
    true = np.sqrt(np.mean([one.constant.mean() for one in found]))
    ends = [rmse_interval(one) for one in found]
    assert np.mean([end.low <= true <= end.high for end in ends]) >= 0.8
    # with what the motion does counted as chance too, they are twice as wide
    one = found[0]
    chance = replace(one, motion=0.0 * one.motion, block=block_length(one.constant))
    assert width(one) < 0.7 * width(chance)


def test_the_offset_has_an_interval_where_it_was_fitted():
    interval = offset_interval(scored(0, 1.0, 1e-3, offset_sigma_s=1e-4), 250.0)
    assert (interval.low, interval.high) == pytest.approx((249.804, 250.196), abs=1e-3)
    assert interval.scope == "take"
    assert offset_interval(scored(0, 1.0, 1e-3), 250.0) is None
