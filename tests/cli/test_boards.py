"""leaderboard, compare, verify and schema as a user types them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from tests.results.made_up import made_up
from vrbench.cli import cli
from vrbench.errors import VrbenchError

HOSTILE = "\x1b[2Jheadset [bold]b[/bold]"


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    rng = np.random.default_rng(9)
    made_up(tmp_path / "a", rng=rng, device="a", error=2.0)
    made_up(tmp_path / "b", rng=rng, device=HOSTILE, error=4.0)
    made_up(tmp_path / "c", rng=rng, device="c", error=4.0, repeats=1)
    monkeypatch.chdir(tmp_path)
    return ["a", "b", "c"]


def vrbench(*arguments: str, columns: int = 80) -> Result:
    return CliRunner().invoke(cli, list(arguments), env={"COLUMNS": str(columns)})


def test_a_board_fits_a_terminal_and_says_why_what_is_not_ranked(runs: list[str]) -> None:
    done = vrbench("leaderboard", *runs)
    assert done.exit_code == 0
    lines = done.stdout.splitlines()
    table = [line for line in lines if re.match(r" +(rank|[-\d]+ )", line)]
    assert len(table) == 4
    assert all(len(line) <= 80 for line in table)
    assert "c of lab-1 has no rank: take scope: it speaks for these takes only" in done.stdout


@pytest.mark.parametrize("columns", [80, 200])
def test_a_name_steers_no_terminal(runs: list[str], columns: int) -> None:
    done = vrbench("leaderboard", *runs, columns=columns)
    assert "\x1b" not in done.stdout
    assert "[bold]" in "".join(done.stdout.split())


def test_a_name_fills_no_terminal(runs: list[str]) -> None:
    made_up(Path("d"), rng=np.random.default_rng(0), device="x" * 300)
    assert vrbench("leaderboard", *runs, "d").stdout.count("x") < 100
    assert "x" * 300 in vrbench("leaderboard", *runs, "d", "--format", "csv").stdout


def test_each_format_goes_to_a_file(runs: list[str]) -> None:
    for form, told in (
        ("csv", "suite,"),
        ("md", "## "),
        ("latex", "\\begin{table}"),
        ("json", "{"),
    ):
        printed = vrbench("leaderboard", *runs, "--format", form)
        assert printed.stdout.startswith(told)
        assert vrbench("leaderboard", *runs, "--format", form, "-o", "board").exit_code == 0
        assert Path("board").read_text(encoding="utf-8") == printed.stdout


def test_a_table_for_the_terminal_goes_to_no_file(runs: list[str]) -> None:
    refused = vrbench("leaderboard", *runs, "-o", "board")
    assert refused.exit_code == 2
    assert "-o needs a --format" in refused.stderr


def test_one_broken_run_is_told_and_the_others_shown(runs: list[str]) -> None:
    (Path("c") / "run.json").write_text("{")
    done = vrbench("leaderboard", *runs)
    assert done.exit_code == 1
    assert "left out: c/run.json: is not JSON" in done.stderr
    assert " a " in done.stdout


def test_a_folder_without_runs_is_refused(runs: list[str]) -> None:
    Path("empty").mkdir()
    done = vrbench("leaderboard", "empty")
    assert isinstance(done.exception, VrbenchError)
    assert "empty: is not a run" in str(done.exception)


def test_compare_says_what_can_be_said(runs: list[str]) -> None:
    separable = vrbench("compare", "a", "b")
    assert separable.exit_code == 0
    assert "replay: separable: a errs less (paired by phase, speaks for mounts)" in separable.stdout
    unsaid = vrbench("compare", "a", "c")
    assert "replay: can't be said: c is" not in unsaid.stdout
    assert "can't be said: these takes only" in unsaid.stdout


def test_a_lab_s_name_steers_no_terminal(runs: list[str], tmp_path: Path) -> None:
    lab = "\x1b[2J\a\u202elab"
    made_up(tmp_path / "d", rng=np.random.default_rng(3), device="d", lab=lab)
    said = vrbench("compare", "a", "d").stdout
    assert "lab may differ" in said
    assert not {"\x1b", "\a", "\u202e"} & set(said)


def test_verify_names_what_is_missing(runs: list[str]) -> None:
    Path("a/takes/replay.default.m1.r1.mcap").unlink()
    done = vrbench("verify", "a")
    assert done.exit_code == 1
    assert "a: takes/replay.default.m1.r1.mcap: is missing" in done.stderr
    assert "0 of 1 runs are sound" in done.stdout
    for arguments in ((), ("a", "--folder", ".")):
        refused = vrbench("verify", *arguments)
        assert "give runs, or --folder" in str(refused.exception)


def test_schemas_are_json() -> None:
    for name in ("suite", "rig", "recordings", "results"):
        assert json.loads(vrbench("schema", name).stdout)["type"] == "object"
