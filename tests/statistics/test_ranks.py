"""Ranks: what is the same shares places nearly always, what differs is told apart."""

from __future__ import annotations

import numpy as np
import pytest

from vrbench.statistics.ranks import Measured, interval, rank, separation, told_apart

BINS = 60


def measured(rng, scale, mount_scatter, hard, mounts=2, repeats=3):
    """A device of a true error, whose mounts scatter by a share of it."""
    squares = []
    for _ in range(mounts):
        mount = scale * np.exp(rng.normal(0, mount_scatter))
        noise = np.exp(rng.normal(0, 0.3, (repeats, BINS)))
        squares.append(np.mean((mount * hard * noise) ** 2, axis=0))
    squares = np.array(squares)
    rmse = np.sqrt(squares.mean())
    by_bin = (squares.mean(axis=0) / rmse + rmse) / 2
    return Measured(rmse, np.sqrt(squares.mean(axis=1)), np.arange(BINS), by_bin, rmse)


def hardness(rng):
    return rng.uniform(0.5, 3.0, BINS)


@pytest.mark.parametrize("devices", [2, 5, 12])
@pytest.mark.parametrize("scatter", [0.0, 0.03, 0.1])
def test_boards_of_the_same_device_are_split_in_a_twentieth_of_cases_at_most(devices, scatter):
    rng = np.random.default_rng([devices, int(scatter * 100)])
    wrong = 0
    for _ in range(200):
        hard = hardness(rng)
        wrong += told_apart([measured(rng, 1.0, scatter, hard) for _ in range(devices)]).any()
    # 5 %, and what two standard deviations of chance add in 200 draws
    assert wrong / 200 <= 0.05 + 0.031


def test_one_device_whose_mounts_scatter_more_does_not_split_a_board():
    rng = np.random.default_rng(3)
    wrong = 0
    for _ in range(200):
        hard = hardness(rng)
        board = [measured(rng, 1.0, s, hard) for s in (0.02, 0.02, 0.02, 0.12)]
        wrong += told_apart(board).any()
    assert wrong / 200 <= 0.05 + 0.031


@pytest.mark.parametrize(("ratio", "least"), [(1.2, 0.35), (1.4, 0.8), (2.0, 0.97)])
def test_different_devices_are_told_apart(ratio, least):
    rng = np.random.default_rng(4)
    found = 0
    for _ in range(100):
        hard = hardness(rng)
        found += separation(measured(rng, ratio, 0.03, hard), measured(rng, 1.0, 0.03, hard)).told
    assert found / 100 >= least


def test_the_true_order_of_devices_lies_within_their_places():
    rng = np.random.default_rng(5)
    kept = 0
    for _ in range(100):
        hard = hardness(rng)
        places = rank([measured(rng, s, 0.05, hard) for s in (1.0, 1.1, 1.3, 2.0, 2.1)])
        kept += all(best <= true <= last for true, (best, last) in enumerate(places, 1))
    assert kept >= 95


def exact(value, spread=0.01, floor=0.0):
    """A number whose two mounts are so far apart."""
    clusters = np.array([value - spread, value + spread])
    return Measured(value, clusters, np.zeros(0, dtype=int), np.zeros(0), value, floor)


def test_places_where_only_the_ends_differ():
    """A ~ B and B ~ C, but A < C: every two that can't be told apart have a place in common."""
    a, b, c = exact(1.0, 0.04), exact(1.15, 0.04), exact(1.3, 0.04)
    told = told_apart([a, b, c])
    assert told.tolist() == [[False, False, True], [False, False, False], [True, False, False]]
    assert rank([a, b, c]) == [(1, 2), (1, 3), (2, 3)]


def test_equal_numbers_share_all_places():
    assert rank([exact(1.0)] * 4) == [(1, 4)] * 4
    assert rank([exact(1.0)]) == [(1, 1)]


def test_numbers_below_the_floor_are_not_told_apart():
    assert rank([exact(1.0), exact(3.0)]) == [(1, 1), (2, 2)]
    assert rank([exact(1.0, floor=5.0), exact(3.0, floor=5.0)]) == [(1, 2), (1, 2)]


def test_pairing_by_phase_sees_what_the_motion_hides():
    rng = np.random.default_rng(6)
    hard = 4.0 * hardness(rng) ** 3
    pair = [measured(rng, s, 0.0, hard, mounts=4) for s in (1.3, 1.0)]
    found = separation(*pair)
    alone = [interval(one) for one in pair]
    assert found.told and found.paired
    assert alone[0][0] < alone[1][1], "the intervals overlap: unpaired, nothing could be said"


def test_an_interval_of_a_difference_holds_the_truth():
    rng = np.random.default_rng(7)
    held = 0
    for _ in range(200):
        hard = hardness(rng)
        truth = 0.3 * np.sqrt(np.mean(hard**2) * np.exp(2 * 0.3**2)) * np.exp(2 * 0.05**2 / 2)
        found = separation(measured(rng, 1.3, 0.05, hard), measured(rng, 1.0, 0.05, hard))
        held += found.low <= truth <= found.high
    assert held / 200 >= 0.93
