"""The world of a calibration in the takes after it, on simulated truth: `ape.*.sitting`."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import Quiet, evaluated
from tests.test_evaluation import one, recentred, rewrite, truth
from vrbench.config.rig import load_rig
from vrbench.config.suite import Suite
from vrbench.plugin.manager import Plugins
from vrbench.recording.take import read_take
from vrbench.results.bundle import Bundle
from vrbench.results.tables import Row
from vrbench.runner import record_suite
from vrbench.streams import Columns

# All but still, and its world moves by half a millimetre in five seconds.
RIG = """
lab: simulated
headset:
  plugin: sim
  device: sim
  options:
    tracking: {drift_m_per_min: 0.006, position_noise_m: 0.0001, rotation_noise_rad: 0.0001}
robot: {plugin: sim}
"""
T, R = "ape.translation.sitting", "ape.rotation.sitting"


@pytest.fixture(scope="module")
def _drifting(tmp_path_factory: pytest.TempPathFactory, short_suite: Suite) -> Path:
    folder = tmp_path_factory.mktemp("sitting")
    (folder / "rig.yaml").write_text(RIG)
    rig = load_rig(str(folder / "rig.yaml"))
    record_suite(short_suite, rig, "rig", folder / "run", Plugins(), seed=5, watcher=Quiet())
    return folder / "run"


@pytest.fixture
def drifting(_drifting: Path, tmp_path: Path) -> Path:
    """A run in one world that drifts; a test may change it."""
    return Path(shutil.copytree(_drifting, tmp_path / "run"))


def sitting(rows: list[Row], metric: str = T, segment: str = "all", **more: str) -> Row:
    """The row of the first replay, at the eye, but for what `more` says."""
    wanted = {"case": "replay", "variant": "main", "band": "all", "segment": segment}
    statistic = {"statistic": "rmse", "point": "eye", "repeat": "1"}
    return one(rows, metric=metric, **{**wanted, **statistic, **more})


def middle_s(run: Path, take: str) -> float:
    """The middle of a take [s], host clock."""
    robot = read_take(run / "takes" / f"{take}.mcap").poses["robot/tcp"]
    return float(np.mean(robot.receive_t)) / 1e9


def test_a_drift_between_takes_counts_in_the_sitting(drifting: Path) -> None:
    rows = evaluated(Bundle.open(drifting))
    speed = np.linalg.norm(truth(drifting, "replay.default.m1.r1")["drift_m_per_s"])
    begin = middle_s(drifting, "calibrate.default.m1.r1")
    for repeat in ("1", "2"):
        after_s = middle_s(drifting, f"replay.default.m1.r{repeat}") - begin
        found = sitting(rows, repeat=repeat)
        assert found.status == "ok"
        assert found.value == pytest.approx(1e3 * speed * after_s, rel=0.1), repeat
        assert sitting(rows, "ape.translation.aligned", repeat=repeat).value < 1.2
        assert sitting(rows, R, repeat=repeat).value < 0.1


def test_a_recentre_ends_the_sitting(drifting: Path) -> None:
    rows = evaluated(rewrite(drifting, "replay.default.m1.r1", lambda c: recentred(c, 16.0)))
    assert sitting(rows, segment="epoch:0").value < 5.0
    after = [r for r in rows if (r.metric, r.segment, r.repeat) == (T, "epoch:1", "1")]
    assert [r.status for r in after] == ["skipped"]
    assert "it recentred in between, or was started anew" in after[0].reason
    assert "calibrate.default.m1.r1" in after[0].reason


@pytest.mark.parametrize(
    ("world", "why"),
    [({"world": "another run"}, "or was started anew"), ({}, "doesn't say which world")],
)
def test_a_world_that_is_another_or_unknown_is_none_of_the_sitting(
    drifting: Path, world: Mapping[str, str], why: str
) -> None:
    def change(columns: Columns) -> Columns:
        others = {k: v for k, v in columns.metadata.items() if k != "world"}
        return replace(columns, metadata={**others, **world})

    rows = evaluated(rewrite(drifting, "replay.default.m1.r1", change))
    skipped = [r for r in rows if r.metric in (T, R) and r.repeat == "1" and r.case == "replay"]
    skipped = [r for r in skipped if r.variant == "main"]
    assert {r.status for r in skipped} == {"skipped"}
    assert all(why in r.reason for r in skipped)
    assert sitting(rows, repeat="2").status == "ok"


def test_each_take_s_metadata_names_its_world(drifting: Path) -> None:
    names = [t["file"] for t in json.loads((drifting / "run.json").read_text())["takes"]]
    assert {read_take(drifting / name).metadata["world"] for name in names} == {"seed 5 mount 1"}
