"""`vrbench ape` prints what evo_ape and evo_rpe print, and says what is wrong with the rest."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.cli.test_cli import refused, vrbench
from vrbench.cli._evo import difference
from vrbench.recording.take import read_take

needs_evo = pytest.mark.skipif(
    importlib.util.find_spec("evo") is None, reason="evo isn't installed: pip install '.[evo]'"
)
OPTIONS = [
    ([], []),
    (["--align"], ["-a"]),
    (["--rotation"], ["-r", "angle_deg"]),
    (["--align", "--rotation"], ["-a", "-r", "angle_deg"]),
    (["--rpe", "1 frame"], ["--delta", "1", "--delta_unit", "f"]),
    (["--rpe", "72 frames", "--align"], ["--delta", "72", "--delta_unit", "f", "-a"]),
    (["--rpe", "0.5 m"], ["--delta", "0.5", "--delta_unit", "m"]),
    (["--rpe", "0.1m", "--all-pairs"], ["--delta", "0.1", "--delta_unit", "m", "--all_pairs"]),
    (
        ["--rpe", "10 deg", "--rotation"],
        ["--delta", "10", "--delta_unit", "d", "-r", "angle_deg"],
    ),
    (["--rpe", "0.2 rad"], ["--delta", "0.2", "--delta_unit", "r"]),
    (["--max-diff", "0.001"], ["--t_max_diff", "0.001"]),
]


def as_text(run: Path, folder: Path) -> tuple[Path, Path]:
    """A robot's and a headset's poses, of a simulated take, as TUM text at epoch stamps."""
    columns = read_take(run / "takes" / "replay.default.m1.r1.mcap")
    files = folder / "robot.tum", folder / "headset.tum"
    for file, stream in zip(files, ("robot/tcp", "headset/eye"), strict=True):
        poses = columns.poses[stream].trajectory()
        t = 1.7e9 + poses.seconds(0)
        np.savetxt(file, np.column_stack((t, poses.pose.p, poses.pose.q)), fmt="%.9f")
    return files


@pytest.fixture
def pair(run: Path, tmp_path: Path) -> tuple[Path, Path]:
    return as_text(run, tmp_path)


# Loading it takes a second: one process says all that is asked of it.
EVO = """
import json, sys
from importlib.metadata import entry_points
for program, *words in json.loads(sys.argv[1]):
    (entry,) = entry_points(group="console_scripts", name=program)
    sys.argv = [program, *words, "-v", "--no_warnings"]
    print("\\f", end="", flush=True)
    entry.load()()
"""


@pytest.fixture(scope="module")
def said(_run: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, ...], str]:
    """What evo prints, by its options."""
    folder = tmp_path_factory.mktemp("evo")
    files = [path.name for path in as_text(_run, folder)]
    programs = ["evo_rpe" if "--rpe" in ours else "evo_ape" for ours, _ in OPTIONS]
    asked = [
        [program, "tum", *files, *theirs]
        for program, (_, theirs) in zip(programs, OPTIONS, strict=True)
    ]
    done = subprocess.run(
        [sys.executable, "-c", EVO, json.dumps(asked)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    _, *printed = done.stdout.split("\f")
    return {tuple(theirs): text for (_, theirs), text in zip(OPTIONS, printed, strict=True)}


def statistics(printed: str) -> list[str]:
    return re.findall(r"^ +[a-z]+\t[0-9.]+$", printed, re.MULTILINE)


@needs_evo
@pytest.mark.parametrize(("ours", "theirs"), OPTIONS, ids=lambda words: " ".join(words) or "none")
def test_statistics_are_evo_s_to_the_digit(pair, said, tmp_path, ours, theirs) -> None:
    done = vrbench("ape", *pair, *ours, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    title = done.stdout.split("\n", 1)[1].split("\n\n")[0]
    assert title in said[tuple(theirs)]
    assert len(statistics(done.stdout)) == 7
    assert statistics(done.stdout) == statistics(said[tuple(theirs)])


@needs_evo
@pytest.mark.parametrize("words", [[], ["--align", "--rotation"], ["--rpe", "10 deg", "--align"]])
@pytest.mark.parametrize("kind", ["tum", "mcap", "both"])
def test_cross_check_runs_evo_on_the_same_poses(pair, run, tmp_path, words, kind) -> None:
    take = run / "takes" / "replay.default.m1.r1.mcap"
    sources = {
        "tum": pair,
        "mcap": (f"{take}:/robot/tcp", f"{take}:/headset/eye/pose"),
        "both": (pair[0], f"{take}:/headset/eye/pose"),
    }[kind]
    if kind == "both":  # on the take's own clock
        robot = np.loadtxt(pair[0])
        robot[:, 0] -= 1.7e9
        np.savetxt(pair[0], robot, fmt="%.9f")
    done = vrbench("ape", *sources, *words, "--cross-check", "evo", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "agrees with evo: largest difference" in done.stdout


def test_without_evo_the_cross_check_says_how_to_get_it(pair, tmp_path, monkeypatch) -> None:
    from vrbench.cli import _evo
    from vrbench.errors import ConfigError

    monkeypatch.setattr(_evo, "entry_points", lambda **_: ())
    with pytest.raises(ConfigError, match=r"evo is not installed \(pip install 'vrbench\[evo\]'\)"):
        _evo._program("evo_ape")


def test_a_difference_is_a_part_of_the_number(capsys) -> None:
    from vrbench.cli._evo import show_check

    assert difference(1.0, 1.0 + 1e-6) == pytest.approx(1e-6, rel=1e-3)
    assert difference(1e-17, 3e-17) < 1e-9
    assert show_check({"rmse": 2.0}, {"rmse": 2.0 + 1e-12}) == 0
    assert show_check({"rmse": 2.0}, {"rmse": 2.0 + 1e-8}) == 1
    assert "DIFFERS from evo: largest difference 5.0e-09" in capsys.readouterr().out


def test_an_mcap_take_and_its_poses_as_text_give_the_same_numbers(run, tmp_path) -> None:
    take = run / "takes" / "replay.default.m1.r1.mcap"
    columns = read_take(take)
    for name, stream in (("robot", "robot/tcp"), ("headset", "headset/eye")):
        samples = columns.poses[stream]
        good = samples[samples.good]
        rows = np.column_stack((good.pose_t / 1e9, good.pose.p, good.pose.q))
        np.savetxt(tmp_path / f"{name}.tum", rows, fmt="%.17g")
    text = vrbench("ape", "robot.tum", "headset.tum", "--align", cwd=tmp_path)
    binary = vrbench(
        "ape", f"{take}:/robot/tcp", f"{take}:/headset/eye/pose", "--align", cwd=tmp_path
    )
    assert text.returncode == binary.returncode == 0
    assert statistics(text.stdout) == statistics(binary.stdout)


POSES = "".join(f"{i / 10} {i} {i * i} 0 0 0 0 1\n" for i in range(10))


@pytest.mark.parametrize(
    ("text", "code", "told"),
    [
        (POSES.replace("0.3", "nan", 1), 1, "stamp of pose 4 is nan"),
        (POSES.replace(" 9 0 ", " inf 0 ", 1), 1, "pose 4 holds a value that is not finite"),
        ("a,b,c\n1,2,3\n", 1, "is not TUM text"),
        ("0 1 2\n1 2 3\n", 1, "rows have 3 columns"),
        ("", 1, "holds no poses"),
        (POSES.replace("0.", "7."), 1, "lie within 0.01 s"),
    ],
)
def test_a_wrong_file_is_told(tmp_path: Path, text: str, code: int, told: str) -> None:
    (tmp_path / "good.tum").write_text(POSES)
    (tmp_path / "bad.tum").write_text(text)
    refused(vrbench("ape", "good.tum", "bad.tum", cwd=tmp_path), code, told)


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["good.tum", "gone.tum"], 1, "gone.tum: can't be read"),
        (["good.tum", "gone.mcap:/robot/tcp"], 1, "gone.mcap: no such take"),
        (["good.tum", "good.mcap"], 2, "good.mcap: which topic?"),
        (["good.tum", "good.tum", "--all-pairs"], 2, "--all-pairs is of --rpe"),
        (["good.tum", "good.tum", "--rpe", "2 miles"], 2, "'2 miles' is no distance of poses"),
        (["good.tum", "good.tum", "--rpe", "1.2.3 m"], 2, "is no distance of poses"),
        (["good.tum", "good.tum", "--rpe", "1.5 frames"], 2, "frames are whole"),
        (["good.tum", "good.tum", "--rpe", "0 m"], 2, "must be more than nought"),
        (["good.tum", "good.tum", "--rpe", "181 deg"], 2, "beyond half a turn"),
        (["good.tum", "good.tum", "--rpe", "10 frames"], 1, "10 frames apart"),
        (["good.tum", "good.tum", "--max-diff", "-1"], 2, "--max-diff"),
    ],
)
def test_what_the_user_got_wrong_is_told(tmp_path: Path, words, code: int, told: str) -> None:
    (tmp_path / "good.tum").write_text(POSES)
    refused(vrbench("ape", *words, cwd=tmp_path), code, told)


def test_a_topic_that_is_not_there_is_told_with_those_that_are(run: Path, tmp_path: Path) -> None:
    take = run / "takes" / "replay.default.m1.r1.mcap"
    done = vrbench("ape", f"{take}:/robot/tcp", f"{take}:/headset", cwd=tmp_path)
    refused(done, 1, "/headset: no such topic")
    refused(done, 1, "/headset/eye/pose")
    done = vrbench("ape", f"{take}:/robot/tcp", f"{take}:/headset/eye/samples", cwd=tmp_path)
    refused(done, 1, "the topic holds vrbench_msgs/msg/Sample")
