"""The wheel: installed alone, it holds suites and recordings and its command works."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

REPO = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scripts of a new environment that has the wheel, and sees the dependencies here."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    subprocess.run(
        [
            *pip,
            "wheel",
            "--no-deps",
            "--no-build-isolation",
            "--no-index",
            "--wheel-dir",
            str(folder),
            str(REPO),
        ],
        check=True,
        timeout=120,
    )
    (wheel,) = folder.glob("*.whl")
    venv.create(folder / "env", with_pip=False)
    target = next((folder / "env").glob("lib/python3*/site-packages"))
    # Dependencies are seen, editable installs are not: .pth files of a path are not followed.
    here = next(path for path in sys.path if path.endswith("site-packages"))
    (target / "dependencies.pth").write_text(here + "\n")
    subprocess.run(
        [
            *pip,
            "--python",
            str(folder / "env" / "bin" / "python"),
            "install",
            "--no-index",
            "--no-deps",
            "--ignore-installed",
            str(wheel),
        ],
        check=True,
        timeout=120,
    )
    return folder / "env" / "bin"


def in_it(installed: Path, *command: str) -> str:
    """What a command prints in the new environment, which sees no checkout and no plugin."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [str(installed / command[0]), *command[1:]],
        cwd=installed,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**environment, "VRBENCH_PLUGINS": ""},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_installed_package_is_the_wheel_s(installed: Path) -> None:
    where = in_it(installed, "python", "-c", "import vrbench; print(vrbench.__file__)")
    assert str(installed.parent) in where


def test_it_has_its_suites(installed: Path) -> None:
    listed = in_it(installed, "vrbench", "suite", "list")
    assert "gameplay-replay@1" in listed
    assert "calibration@1" in listed


def test_it_has_its_recordings(installed: Path) -> None:
    assert "banaszczyk2024-quest-2" in in_it(installed, "vrbench", "data", "list")


def test_it_has_what_pages_are_made_of(installed: Path) -> None:
    code = (
        "from vrbench.results.report.pages import _environment, script, style; "
        "print(len(script()) > 1000, len(style()) > 1000, "
        "all(_environment().get_template(f'{name}.html.j2') "
        "for name in ('run', 'board', 'home', 'runs')))"
    )
    assert in_it(installed, "python", "-c", code).split() == ["True", "True", "True"]


def test_it_has_what_others_published(installed: Path) -> None:
    code = "from vrbench.results.published import published; print(published()[0].source)"
    assert "Banaszczyk" in in_it(installed, "python", "-c", code)
