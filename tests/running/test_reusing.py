"""A run that begins with the calibration of an earlier one."""

from __future__ import annotations

import json

import pytest

from tests.conftest import Quiet, evaluated, recorded
from vrbench.config.rig import load_rig
from vrbench.config.suite import load_suite
from vrbench.errors import ConfigError
from vrbench.plugin.manager import Plugins
from vrbench.results.bundle import Bundle
from vrbench.results.files import file_digest
from vrbench.results.record import utc_now
from vrbench.runner import record_suite
from vrbench.running.reusing import _may_tell_of_hands, reused


def again(suite, folder, earlier, rig="sim:sim", seed=7):
    return record_suite(
        *(suite, load_rig(rig), "sim:sim", folder, Plugins()),
        watcher=Quiet(),
        seed=seed,
        calibration=earlier,
    )


def test_the_calibration_that_ended_a_run_opens_the_next(run, short_suite, tmp_path):
    bundle = again(short_suite, tmp_path / "next", run)
    first, *others = bundle.record.takes
    assert (first.name, first.origin) == ("calibrate.default.m1.r1", "run/calibrate.default.m1.r2")
    assert first.sha256 == file_digest(run / "takes" / "calibrate.default.m1.r2.mcap")
    assert [take.origin for take in others] == ["", "", ""]
    rows = evaluated(bundle)
    ape = [
        row
        for row in rows
        if (row.metric, row.point, row.statistic, row.variant, row.case, row.segment, row.band)
        == ("ape.translation.aligned", "eye", "rmse", "main", "replay", "all", "all")
    ]
    # the same mounting as before, in time after it: both calibrations hold, and agree
    assert [row.status for row in ape] == ["ok"] * 3
    starts = [bundle.columns(take).poses["headset/eye"].pose_t[0] for take in bundle.record.takes]
    assert starts == sorted(starts)


def test_what_was_made_with_something_else_is_refused(run, short_suite, tmp_path):
    with pytest.raises(ConfigError, match=r"another seed: 7, not 8.*--seed 7"):
        again(short_suite, tmp_path / "next", run, seed=8)
    with pytest.raises(ConfigError, match="another rig"):
        again(short_suite, tmp_path / "next", run, rig="sim:quest-2")
    assert not (tmp_path / "next").exists()


def test_a_run_that_ends_with_another_calibration_is_refused(run, tmp_path, short_suite_path):
    text = short_suite_path.read_text().replace("calibration: saturate-30s-1", "calibration: q")
    other = tmp_path / "other.yaml"
    other.write_text(text.replace("calibration: q", "calibration: saturate-1"))
    with pytest.raises(ConfigError, match="no whole calibration 'calibrate' by saturate-1"):
        again(load_suite(str(other)), tmp_path / "next", run)


def test_a_calibration_that_was_changed_is_refused(run, short_suite, tmp_path):
    for take in (run / "takes").glob("calibrate*"):
        take.write_bytes(take.read_bytes() + b"\0")
    with pytest.raises(ConfigError, match="no whole calibration"):
        again(short_suite, tmp_path / "next", run)


def test_an_old_calibration_is_refused(run, short_suite, tmp_path):
    """Virtual time has no age; a recorded run of 2023 has."""
    record = json.loads((run / "run.json").read_text()) | {"kind": "recorded"}
    (run / "run.json").write_text(json.dumps(record))
    bundle = Bundle.open(run)
    inputs = {"rig.yaml": (run / "rig.yaml").read_text()}
    with pytest.raises(ConfigError, match=r"min old, the gate is 60 min"):
        reused(run, short_suite, bundle.record, inputs)


def test_a_run_in_which_the_headset_was_fixed_anew_or_touched_is_refused(
    run, short_suite, tmp_path
):
    record = json.loads((run / "run.json").read_text())
    record["takes"].append(record["takes"][-1] | {"mount": 2, "file": "takes/x.mcap"})
    (run / "run.json").write_text(json.dumps(record))
    with pytest.raises(ConfigError, match="fixed anew"):
        again(short_suite, tmp_path / "next", run)


def test_a_run_in_which_cameras_were_covered_is_refused(short_suite_path, tmp_path):
    text = (
        short_suite_path.read_text()
        .replace("repeats: 2,", "")
        .replace(
            "anchor: 5 s}",
            "events: [{after: 0, do: occlude, level: two}, {after: 1, do: uncover}]}",
        )
    )
    covering = tmp_path / "covering.yaml"
    covering.write_text(text)
    suite = load_suite(str(covering))
    earlier = recorded(suite, tmp_path / "earlier", "sim:quest-pro")
    with pytest.raises(ConfigError, match=r"cameras are covered in replay.default.m1.r1"):
        again(suite, tmp_path / "next", earlier.folder, "sim:quest-pro")
    assert not (tmp_path / "next").exists()
    # of a real headset only what hands did since its last calibration counts
    record = json.loads((earlier.folder / "run.json").read_text()) | {"kind": "recorded"}
    record["created"] = utc_now().isoformat()
    (earlier.folder / "run.json").write_text(json.dumps(record))
    takes = Bundle.open(earlier.folder).record.takes
    assert [take.role for take in takes] == ["calibration", "scored", "calibration"]
    told = list(_may_tell_of_hands(Bundle.open(earlier.folder), takes[-1:]))
    assert [take.name for take in told] == ["calibrate.default.m1.r2"]
