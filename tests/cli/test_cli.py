"""The command line: exit codes, one clear error, no traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import BytesIO, TextIOWrapper
from pathlib import Path

import pytest

from tests.conftest import SHORT
from vrbench.cli import main


@dataclass(frozen=True)
class Done:
    """What a command left behind."""

    returncode: int
    stdout: str
    stderr: str


def vrbench(*words: str | Path, cwd: Path, **environment: str) -> Done:
    """The command within this process: everything but the start of Python is as a user has it."""
    out, err = (TextIOWrapper(BytesIO(), "utf-8", write_through=True) for _ in range(2))
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.chdir(cwd)
        patch.setattr("sys.argv", ["vrbench", *map(str, words)])
        for name, value in {"COLUMNS": "200", **environment}.items():
            patch.setenv(name, value)
        code = None
        try:
            main()
        except SystemExit as stop:
            code = stop.code
    texts = [stream.buffer.getvalue().decode() for stream in (out, err)]
    return Done(code or 0, *texts)


def typed(*words: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "vrbench", *map(str, words)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env={**os.environ, "COLUMNS": "200"},
    )


def refused(done: Done | subprocess.CompletedProcess[str], code: int, told: str) -> None:
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    assert told in " ".join(done.stderr.split()), done.stderr


def test_help_teaches_every_verb(tmp_path: Path) -> None:
    done = vrbench("--help", cwd=tmp_path)
    assert done.returncode == 0
    for verb in (
        "ape",
        "run",
        "record",
        "import",
        "evaluate",
        "leaderboard",
        "compare",
        "verify",
        "schema",
        "report",
        "export",
        "plugin",
        "suite",
        "data",
    ):
        assert f"\n  {verb} " in done.stdout
        own = vrbench(verb, "--help", cwd=tmp_path)
        assert own.returncode == 0
        assert "Usage:" in own.stdout


def test_a_suite_is_run_scored_and_ranked(tmp_path: Path, short_suite_path: Path) -> None:
    done = typed("run", short_suite_path, "--rig", "sim:sim", "-o", "mine", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Metrics" in done.stdout
    assert "run: mine" in done.stdout
    assert "report: mine/report.html" in done.stdout
    assert (tmp_path / "mine" / "report.html").is_file()
    assert (tmp_path / "mine" / "metrics" / "vrbench-1.csv").is_file()
    board = typed("leaderboard", "mine", cwd=tmp_path)
    assert board.returncode == 0
    assert "short@1" in board.stdout
    again = typed("run", short_suite_path, "--rig", "sim:sim", "-o", "mine", cwd=tmp_path)
    refused(again, 2, "mine: -o: is there already")


def test_record_and_evaluate_are_run_in_two_steps(tmp_path: Path) -> None:
    (tmp_path / "once.yaml").write_text(SHORT.replace("repeats: 2, ", ""))
    done = vrbench("record", "once.yaml", "--rig", "sim:sim", "-o", "mine", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "mine" / "metrics").exists()
    refused(vrbench("leaderboard", "mine", cwd=tmp_path), 1, "vrbench evaluate RUN")
    assert vrbench("evaluate", "mine", cwd=tmp_path).returncode == 0


def test_a_run_without_calibration_is_scored_as_invalid(tmp_path: Path, run: Path) -> None:
    import json

    record = json.loads((run / "run.json").read_text())
    record["takes"] = [take for take in record["takes"] if take["role"] == "scored"]
    (run / "run.json").write_text(json.dumps(record))
    refused(
        vrbench("evaluate", run, cwd=tmp_path),
        1,
        "invalid: replay mount 1 repeat 1: no calibration in this mount",
    )


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["run", "gameplay"], "Missing option '--rig'"),
        (["run", "gameplay", "--rig", "sim"], "no suites file or name is 'gameplay'"),
        (["run", "gameplay-replay@7", "--rig", "sim"], "it is gameplay-replay@1"),
        (["run", "gameplay-replay", "--rig", "lab.yaml"], "lab.yaml: no such rig file"),
        (["run", "gameplay-replay", "--rig", "sim:quest-9"], "no headset is called 'quest-9'"),
        (["import", "gone"], "no recordings file or name is 'gone'"),
        (["import", "gone.yaml"], "gone.yaml: no such file"),
        (["evaluate", "gone"], "gone: is not a run"),
        (["leaderboard", "gone"], "gone: is not a run"),
        (["suite", "check", "odd.yaml"], "odd.yaml:14:1: colour: there is no such field"),
        (["dance"], "No such command 'dance'"),
    ],
)
def test_what_the_user_got_wrong_is_told_once(tmp_path: Path, words: list[str], told: str) -> None:
    (tmp_path / "odd.yaml").write_text(SHORT + "\n\ncolour: red\n")
    done = vrbench(*words, cwd=tmp_path)
    refused(done, 2, told)
    assert not (tmp_path / "runs").exists()


def test_a_rig_that_is_simulated_in_part_is_refused(tmp_path: Path) -> None:
    (tmp_path / "lab.yaml").write_text(
        "lab: mine\nheadset: {plugin: sim, device: sim}\nrobot: {plugin: sim}\n"
        "mocap: {plugin: optitrack}\n"
    )
    done = vrbench("run", "calibration", "--rig", "lab.yaml", cwd=tmp_path)
    refused(done, 2, "lab.yaml: headset: is simulated, and other devices of the rig are not")


@pytest.mark.parametrize("option", ["rate_hz: 5", "ratehz: 100"])
def test_options_of_devices_are_checked(tmp_path: Path, option: str) -> None:
    (tmp_path / "lab.yaml").write_text(
        "lab: mine\nheadset: {plugin: sim, device: sim}\n"
        f"robot: {{plugin: sim, options: {{{option}}}}}\n"
    )
    refused(
        vrbench("run", "calibration", "--rig", "lab.yaml", cwd=tmp_path),
        2,
        "lab.yaml:3:32: robot.options." + option.split(":")[0],
    )


def test_data_list_says_what_is_missing_and_how_to_get_it(tmp_path: Path) -> None:
    done = vrbench("data", "list", cwd=tmp_path, VRBENCH_DATA="")
    assert done.returncode == 0
    assert "set VRBENCH_DATA to the folder that holds banaszczyk2024/" in done.stdout
    assert "lacks" in done.stdout


def test_data_list_finds_an_altered_file(tmp_path: Path) -> None:
    file = tmp_path / "banaszczyk2024/data/experiments/quest2/center_eye_data/calib.txt"
    file.parent.mkdir(parents=True)
    file.write_text("not this")
    done = vrbench("data", "list", cwd=tmp_path, VRBENCH_DATA=str(tmp_path))
    assert done.returncode == 1
    assert "altered" in done.stdout


def test_lists_show_what_there_is(tmp_path: Path) -> None:
    plugins = vrbench("plugin", "list", cwd=tmp_path)
    assert plugins.returncode == 0
    for name in ("builtin", "rosbag1", "tum", "ape", "gameplay-replay"):
        assert name in plugins.stdout
    suites = vrbench("suite", "list", cwd=tmp_path)
    assert "gameplay-replay@1" in suites.stdout
    shown = vrbench("suite", "show", "calibration", cwd=tmp_path)
    assert "take: calibrate.default.m1.r2" in shown.stdout


def test_a_closed_pipe_is_no_error(tmp_path: Path) -> None:
    done = subprocess.run(
        f"{sys.executable} -m vrbench plugin list | head -n 1",
        shell=True,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert "Traceback" not in done.stderr
    assert "Exception" not in done.stderr
