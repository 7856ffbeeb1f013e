"""The verbs that write pages and exports."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from tests.cli.test_cli import refused, vrbench
from vrbench.cli import cli
from vrbench.cli._steps import report_run
from vrbench.results.bundle import Bundle


def invoke(*words):
    return CliRunner().invoke(cli, [str(word) for word in words], catch_exceptions=False)


def test_a_report_is_written_and_its_place_told(run: Path) -> None:
    done = invoke("report", run)
    assert done.exit_code == 0
    assert done.output == f"report: {run / 'report.html'}\n"
    assert Bundle.open(run).content("report.html").startswith(b"<!doctype html>")


def test_a_report_of_what_is_no_run_is_refused(tmp_path: Path) -> None:
    refused(vrbench("report", "nowhere", cwd=tmp_path), 2, "nowhere: is not a run")


def test_run_goes_on_without_jinja2_and_says_so(run: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    report_run(Bundle.open(run), "vrbench-1")
    assert "no report: it needs jinja2 (pip install 'vrbench[report]')" in capsys.readouterr().err
    assert not (run / "report.html").exists()


def test_a_leaderboard_is_written_as_a_site(run: Path, tmp_path: Path) -> None:
    done = invoke("leaderboard", run, "--format", "html", "-o", tmp_path / "site")
    assert done.exit_code == 0
    assert (tmp_path / "site" / "index.html").is_file()
    assert str(tmp_path) not in (tmp_path / "site" / "index.html").read_text()


def test_a_site_needs_a_folder(run: Path, tmp_path: Path) -> None:
    done = vrbench("leaderboard", run, "--format", "html", cwd=tmp_path)
    refused(done, 2, "--format html needs -o")
    (tmp_path / "mine.txt").write_text("")
    done = vrbench("leaderboard", run, "--format", "html", "-o", ".", cwd=tmp_path)
    refused(done, 2, "holds files already")


def test_what_is_left_out_of_an_export_is_told(run: Path, tmp_path: Path) -> None:
    record = json.loads((run / "run.json").read_text())
    record["takes"] = [take for take in record["takes"] if take["repeat"] == 1]
    (run / "run.json").write_text(json.dumps(record))
    done = vrbench("export", run, "--format", "csv", "-o", "csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "left out: calibrate.default.m1.r1.robot: the mount has no calibration" in done.stderr
    assert "2 files: csv" in done.stdout


@pytest.mark.parametrize("words", [["--format", "tum"], ["-o", "x"], ["--format", "x", "-o", "x"]])
def test_an_export_needs_a_format_and_a_folder(run: Path, tmp_path: Path, words) -> None:
    refused(vrbench("export", run, *words, cwd=tmp_path), 2, "Usage")
