"""Bundles: whole, or marked incomplete."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.conftest import Quiet
from vrbench.config.rig import load_rig
from vrbench.config.suite import Suite
from vrbench.errors import ConfigError, DataError, DeviceError
from vrbench.plugin.manager import Plugins
from vrbench.results.bundle import Bundle
from vrbench.results.files import file_digest
from vrbench.runner import record_suite


def test_the_record_says_what_was_run(run: Path, short_suite: Suite) -> None:
    record = Bundle.open(run).record
    assert record.status == "complete"
    assert record.kind == "simulated"
    assert record.suite_digest == short_suite.digest
    assert record.resolved_suite() == short_suite
    assert record.seed == 7
    assert {"vrbench", "numpy", "python"} <= record.versions.keys()
    for take in record.takes:
        assert file_digest(run / take.file) == take.sha256


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda r: r.update(status="incomplete"), "incomplete"),
        (lambda r: r.update(schema_version=99), "schema version 99"),
        (lambda r: r.update(extra=1), "extra"),
        (lambda r: r.pop("takes") and r.pop("lab"), "lab"),
    ],
)
def test_a_record_that_is_not_sound_is_refused(run: Path, change, told: str) -> None:
    path = run / "run.json"
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))
    with pytest.raises(ConfigError, match=told):
        Bundle.open(run)


@pytest.mark.parametrize("content", [None, "", "{", "[]"])
def test_a_folder_without_a_record_is_no_run(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "run.json").write_text(content)
    with pytest.raises(ConfigError):
        Bundle.open(tmp_path)


def test_a_missing_take_is_named(run: Path) -> None:
    bundle = Bundle.open(run)
    (run / bundle.record.takes[0].file).unlink()
    with pytest.raises(DataError, match="the take is gone"):
        bundle.columns(bundle.record.takes[0])


def test_a_run_that_fails_is_left_marked_as_failed(
    tmp_path: Path, short_suite: Suite, monkeypatch: pytest.MonkeyPatch
) -> None:
    from vrbench.devices.simulated.robot import SimulatedRobot

    whole = SimulatedRobot.execute

    def fail_at_the_second(self, plan):
        if self._take.startswith("replay"):
            raise DeviceError("protective stop", field="robot")
        yield from whole(self, plan)

    monkeypatch.setattr(SimulatedRobot, "execute", fail_at_the_second)
    folder = tmp_path / "run"
    with pytest.raises(DeviceError, match="protective stop"):
        record_suite(
            short_suite, load_rig("sim:sim"), "sim", folder, Plugins(), seed=1, watcher=Quiet()
        )
    record = json.loads((folder / "run.json").read_text())
    assert (record["status"], record["reason"]) == ("failed", "robot: protective stop")
    assert [(take["case"], take["status"]) for take in record["takes"]] == [
        ("calibrate", "ok"),
        ("replay", "failed"),
    ]
    assert [p.name for p in (folder / "takes").glob("*.part")] == ["replay.default.m1.r1.mcap.part"]
    with pytest.raises(ConfigError, match="the run is failed: robot: protective stop"):
        Bundle.open(folder)
