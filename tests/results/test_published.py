"""The paper's printed tables: beside what was measured, marked, and never ranked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.results.made_up import SUITE, made_up
from vrbench.config.yaml_file import validate
from vrbench.errors import ConfigError
from vrbench.results.leaderboard import leaderboard
from vrbench.results.published import Published, published

TABLE = {
    ("gameplay-replay", "quest-2", "traj1"): (2.29, 2.05, None, 8.32),
    ("gameplay-replay", "quest-pro", "traj1"): (3.49, 3.16, None, 8.83),
    ("gameplay-replay", "quest-2", "traj2"): (3.19, 2.85, 1.46, 9.51),
    ("gameplay-replay", "quest-pro", "traj2"): (5.29, 4.74, 2.34, 13.48),
    ("gameplay-replay", "robot", "traj2"): (2.40, 2.16, 1.05, 5.11),
    ("occluded-cameras", "quest-pro", "no camera covered"): (3.05, 2.69, 1.44, 8.73),
    ("occluded-cameras", "quest-pro", "two cameras covered"): (6.08, 5.49, 2.62, 13.60),
    ("occluded-cameras", "quest-pro", "three cameras covered"): (5.56, 5.06, 2.39, 13.59),
    ("calibration", "quest-2", "calib"): (3.17, None, None, 10.48),
    ("calibration", "quest-pro", "calib"): (3.23, None, None, 11.97),
}
HANDEYE = {(9.3, 0.178), (6.2, 0.209), (2.8, 0.179), (42.74, 3.96)}


def test_the_tables_are_those_that_were_printed() -> None:
    rows = [row for publication in published() for row in publication.rows]
    printed = {(r.suite, r.device, r.take): (r.rmse, r.mean, r.std, r.max) for r in rows}
    assert TABLE.items() <= printed.items()
    assert {(r.handeye_mm, r.handeye_deg) for r in rows if r.handeye_mm} == HANDEYE


def test_a_new_run_stands_beside_them(tmp_path: Path) -> None:
    suite = {**SUITE, "suite": "gameplay-replay", "version": 7}
    run = made_up(tmp_path / "a", rng=np.random.default_rng(0), suite=suite, error=9.0)
    ((mine, *others),) = (b.entries for b in leaderboard([run], "vrbench-1").boards)
    assert (mine.places, mine.source) == ("1", "measured")
    assert len(others) == 6
    assert {(e.places, e.rank, e.source, e.status) for e in others} == {
        ("pub.", None, "published", "published")
    }
    best = next(e for e in others if e.name == "quest-2 (traj1)")
    assert best.statistics == {"rmse": 2.29, "mean": 2.05, "std": None, "max": 8.32}
    assert "not scored by vrbench" in best.reason


def test_an_rmse_below_the_mean_is_refused() -> None:
    row = {"suite": "s", "case": "c", "device": "d", "take": "t", "rmse": 0.057, "mean": 0.467}
    content = {"source": "s", "lab": "l", "protocol": "p", "point": "tcp", "rows": [row]}
    with pytest.raises(ConfigError, match="can't be"):
        validate(content, Published, "x.yaml")
