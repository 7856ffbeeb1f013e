"""Conformance reports: who is meant, where the newest lie, and that runs copy them."""

import json

import pytest

from tests.conftest import recorded
from vrbench.config.rig import load_rig
from vrbench.errors import ConfigError
from vrbench.plugin.manager import NARROW, Plugins
from vrbench.plugin.report import VARIABLE, as_text, check, found, keep, newest
from vrbench.results.bundle import Bundle

RANK = "ape"


@pytest.fixture(autouse=True)
def _kept_here(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "reports"))
    monkeypatch.setenv(NARROW, "")


def test_a_plugins_name_means_all_it_offers_and_any_other_the_things_called_so():
    plugins = Plugins()
    assert ("metric", RANK) in found("builtin", plugins)
    assert found("sim", plugins) == [("headset", "sim"), ("mocap", "sim"), ("robot", "sim")]
    assert found("tum", plugins) == [("importer", "tum")]
    with pytest.raises(ConfigError, match=r"is called 'gone' \(plugins are builtin"):
        found("gone", plugins)


@pytest.mark.parametrize("kind", ["metric", "suite", "importer"])
def test_all_that_is_built_in_passes(kind):
    plugins = Plugins()
    for name in plugins.things(kind):
        report = check(kind, name, plugins)
        assert [x for x in report.outcomes if x.status == "failed"] == [], name


def test_the_newest_report_of_a_thing_is_kept_and_found():
    plugins = Plugins()
    assert newest([("metric", RANK)]) is None
    report = check("metric", RANK, plugins)
    path = keep(report)
    assert path.read_text(encoding="utf-8") == as_text([report])
    (told,) = json.loads(newest([("metric", RANK), ("metric", "none")]))
    assert (told["schema"], told["name"], told["passed"]) == (1, RANK, True)
    assert told["outcomes"][0].keys() == {"check", "title", "status", "what", "fix"}


def test_a_report_that_is_no_json_is_passed_by(tmp_path):
    (tmp_path / "reports").mkdir()
    (tmp_path / "reports" / "headset-sim.json").write_text("{")
    assert newest([("headset", "sim")]) is None


def test_a_run_copies_the_newest_reports_of_its_devices(tmp_path, short_suite):
    plugins = Plugins()
    # what is kept of a device that isn't in the rig stays out
    for kind, name in (("headset", "sim"), ("robot", "sim"), ("mocap", "sim")):
        keep(check(kind, name, plugins))
    rig = load_rig("sim:sim")
    assert rig.things == [("headset", "sim"), ("robot", "sim")]
    bundle = recorded(short_suite, tmp_path / "run")
    copied = json.loads((tmp_path / "run" / "conformance.json").read_text(encoding="utf-8"))
    assert [(x["kind"], x["name"]) for x in copied] == [("headset", "sim"), ("robot", "sim")]
    assert copied == json.loads(Bundle.open(bundle.folder).content("conformance.json"))


def test_without_reports_a_run_has_none(run):
    assert not (run / "conformance.json").exists()
