"""A few seeds of `benchmarks/accuracy.py`; its hundreds, and the intervals, are in the docs."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

FILE = Path(__file__).parents[1] / "benchmarks" / "accuracy.py"


@pytest.fixture(scope="module")
def accuracy() -> ModuleType:
    spec = importlib.util.spec_from_file_location("benchmark_of_accuracy", FILE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_chain_is_as_accurate_as_it_says(accuracy: ModuleType) -> None:
    outcomes = [accuracy.outcome(seed, white=False) for seed in range(1000, 1005)]
    assert np.abs([o.offset_s for o in outcomes]).max() < 0.5e-3
    mm, deg = accuracy.lengths(np.array([o.x for o in outcomes]))
    assert np.sqrt(np.mean(mm**2)) < 0.3
    assert np.sqrt(np.mean(deg**2)) < 0.03
    held = np.array([o.x_held for o in outcomes])
    assert held.mean() > 0.75


def test_white_noise_hardly_matters(accuracy: ModuleType) -> None:
    found = accuracy.outcome(1000, white=True)
    mm, deg = accuracy.lengths(found.x[None])
    assert abs(found.offset_s) < 0.2e-3
    assert mm[0] < 0.1
    assert deg[0] < 0.01


def test_no_fit_is_expected_to_beat_the_bound(accuracy: ModuleType) -> None:
    correlated, white = (np.diag(accuracy.bound(white)) for white in (False, True))
    assert np.all(white < 0.1 * correlated)
    per_axis = np.diag(accuracy.bound(False, per_axis=True))
    assert per_axis == pytest.approx(3.0 * correlated)
