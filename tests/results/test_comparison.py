"""compare: a difference with its interval, and what it allows to say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.results.made_up import SUITE, made_up
from vrbench.errors import ConfigError
from vrbench.results.bundle import Bundle
from vrbench.results.comparison import Comparison, compare


@pytest.fixture
def make(tmp_path: Path):
    rng = np.random.default_rng(8)

    def one(name: str, **facts) -> Path:
        return made_up(tmp_path / name, rng=rng, **{"device": name, **facts})

    return one


def compared(first: Path, second: Path) -> Comparison:
    (found,) = compare(Bundle.open(first), Bundle.open(second), "vrbench-1")
    return found


def test_what_differs_is_separable_with_its_difference(make) -> None:
    found = compared(make("a", error=2.0), make("b", error=4.0))
    assert found.verdict == "separable"
    assert found.reason.endswith("a errs less")
    assert found.low < found.difference < found.high < 0
    assert found.difference == pytest.approx(-2.0, rel=0.15)
    assert found.paired
    assert (found.unit, found.scope) == ("mm", "mount")


def test_what_is_the_same_is_not_separable(make) -> None:
    found = compared(make("a", error=2.0), make("b", error=2.0))
    assert found.verdict == "not separable"
    assert found.low < 0 < found.high


def test_below_the_noise_floor_nothing_is_separable(make) -> None:
    found = compared(make("a", error=2.0, floor=9.0), make("b", error=4.0, floor=9.0))
    assert (found.verdict, found.reason) == ("not separable", "both lie below the noise floor")


@pytest.mark.parametrize("facts", [{"mounts": 1}, {"repeats": 1}])
def test_too_few_takes_allow_no_word_on_the_devices(make, facts) -> None:
    found = compared(make("a", error=2.0, **facts), make("b", error=4.0))
    assert found.verdict == "can't be said"
    assert "two mounts of three repeats" in found.reason
    assert found.scope == "take"
    assert found.high < 0, "of these takes the difference is known all the same"


def test_a_run_that_may_not_be_ranked_allows_none_either(make) -> None:
    found = compared(make("a", coverage=50.0), make("b"))
    assert found.verdict == "can't be said"
    assert "low coverage" in found.reason


def test_other_labs_devices_cannot_be_compared_but_one_device_can(make) -> None:
    other = compared(make("a", error=2.0), make("b", error=4.0, lab="lab-2"))
    assert other.verdict == "can't be said"
    assert "lab-1 and lab-2" in other.reason
    same = compared(make("c", device="r"), make("d", device="r", lab="lab-2"))
    assert same.verdict == "not separable"


def test_runs_with_nothing_in_common_say_what_differs(make, tmp_path: Path) -> None:
    first, second = make("a"), make("b", suite={**SUITE, "version": 2})
    with pytest.raises(ConfigError, match=r"suite: made-up@1 and made-up@2"):
        compared(first, second)
    third = make("c")
    record = json.loads((third / "run.json").read_text())
    for take in record["takes"]:
        take["speed"] = 1.24
    (third / "run.json").write_text(json.dumps(record))
    with pytest.raises(ConfigError, match=r"speed: 1.0 and 1.24"):
        compared(first, third)
    with pytest.raises(ConfigError, match="compared with itself"):
        compared(first, first)
