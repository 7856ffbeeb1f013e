"""`vrbench plugin new`: every kind installs, passes its tests, and gets to a leaderboard."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from vrbench.errors import ConfigError
from vrbench.plugin.manager import KINDS
from vrbench.plugin.scaffold import TEMPLATE, scaffold, steps

MADE = {
    "headset": "pico4",
    "mocap": "vicon",
    "robot": "crx",
    "importer": "steam-log",
    "metric": "wander",
    "suite": "short-replay",
}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A plugin of every kind, installed into one folder."""
    folder = tmp_path_factory.mktemp("made")
    folders = [scaffold(kind, name, folder) for kind, name in MADE.items()]
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "install"]
    offline = ["--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run(
        [*pip, *offline, "--target", folder / "installed", *folders], check=True, timeout=120
    )
    return folder


def run(made: Path, *command: str) -> subprocess.CompletedProcess:
    """A command where the made plugins are installed, and no other."""
    names = ",".join(MADE.values())
    told = {
        "PYTHONPATH": str(made / "installed"),
        "VRBENCH_PLUGINS": names,
        "VRBENCH_REPORTS": str(made / "reports"),
    }
    return subprocess.run(
        [sys.executable, *command],
        cwd=made,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
        env={**os.environ, **told},
    )


def test_there_is_a_template_of_every_kind():
    assert {path.name for path in TEMPLATE.iterdir()} - {"shared"} == set(KINDS) == set(MADE)


def test_every_kind_passes_its_own_tests_at_once(made):
    tests = [str(made / f"vrbench-{name}" / "tests") for name in MADE.values()]
    how = ["-q", "-n3", "--dist=loadscope", "-p", "no:cacheprovider", "--rootdir", str(made)]
    done = run(made, "-m", "pytest", *how, *tests)
    assert done.returncode == 0, done.stdout
    assert "skipped" not in done.stdout


def test_every_kind_is_listed_and_sound(made):
    done = run(made, "-m", "vrbench", "plugin", "list")
    assert done.returncode == 0, done.stderr
    assert "broken" not in done.stdout
    for kind, name in MADE.items():
        assert f"vrbench-{name}" in done.stdout, kind


def test_from_plugin_new_to_a_row_on_a_leaderboard_it_is_five_commands(made):
    folder = made / "vrbench-pico4"
    commands = steps(folder, "pico4")
    assert len(commands) + 1 == 5
    assert commands[0].endswith(f"-m pip install --editable {folder}")  # as the fixture did
    for command in commands[1:]:
        done = run(made, "-m", *command.split())
        assert done.returncode == 0, done.stderr
    assert "pico4" in done.stdout
    assert "take scope" in done.stdout


@pytest.mark.parametrize("name", [n for k, n in MADE.items() if k != "headset"])
def test_every_sample_is_imported(made, name):
    recordings = f"vrbench-{name}/sample/recordings.yaml"
    done = run(made, "-m", "vrbench", "import", recordings, "-o", f"{name}-run")
    assert done.returncode == 0, done.stderr


def test_a_check_says_what_the_tests_say_and_keeps_its_report(made):
    done = run(made, "-m", "vrbench", "plugin", "check", "wander", "-o", "wander.json")
    assert done.returncode == 0, done.stdout
    assert "0 failed" in done.stdout
    (report,) = json.loads((made / "wander.json").read_text(encoding="utf-8"))
    assert report == json.loads((made / "reports/metric-wander.json").read_text("utf-8"))[0]
    assert (report["kind"], report["version"], report["passed"]) == ("metric", "0.1.0", True)
    assert {outcome["status"] for outcome in report["outcomes"]} == {"passed"}


def test_nothing_of_the_template_is_left_unfilled(made):
    for path in made.glob("vrbench-*/**/*"):
        if path.suffix in (".py", ".toml", ".md", ".yaml"):
            text = path.read_text(encoding="utf-8")
            assert "${" not in text
            assert "$name" not in text


def test_the_made_modules_are_as_clean_as_the_house(made):
    config = Path(__file__).parents[2] / "pyproject.toml"
    files = [str(path) for path in made.glob("vrbench-*/vrbench_*/__init__.py")]
    assert len(files) == len(MADE)
    command = [sys.executable, "-m", "ruff", "check", "--config", str(config), *files]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("kind", "name", "says"),
    [
        ("camera", "x", "no kind of plugin is 'camera'.*headset"),
        ("headset", "Pico 4", "'Pico 4' is no good name.*pico4"),
        ("headset", "4pico", "no good name"),
        ("headset", "headset", "says what it is and not which"),
        ("metric", "ape", "metric ape is there already, in vrbench"),
        ("suite", "gameplay-replay", "suite gameplay-replay is there already"),
        ("robot", "sim", "robot sim is there already"),
        ("headset", "builtin", "a plugin called builtin is installed already"),
    ],
)
def test_what_is_no_good_is_refused(tmp_path, kind, name, says):
    with pytest.raises(ConfigError, match=says):
        scaffold(kind, name, tmp_path)
    assert not list(tmp_path.iterdir())


def test_its_steps_can_be_pasted_whatever_its_folder_is_called():
    steps_of = steps(Path("my plugins/vrbench-pico4"), "pico4")
    assert shlex.split(steps_of[0])[-1] == "my plugins/vrbench-pico4"
    assert shlex.split(steps_of[1])[2] == "my plugins/vrbench-pico4/sample/recordings.yaml"


def test_a_folder_that_exists_is_left_alone(tmp_path):
    (tmp_path / "vrbench-pico4").mkdir()
    with pytest.raises(ConfigError, match="exists already"):
        scaffold("headset", "pico4", tmp_path)
    assert not list((tmp_path / "vrbench-pico4").iterdir())
