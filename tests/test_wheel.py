"""The wheels: the core alone holds suites and recordings, plugins work alone and together."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

REPO = Path(__file__).parents[1]


PLUGINS = sorted(path.parent for path in REPO.glob("plugins/*/*/pyproject.toml"))
PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheels of the core and of every plugin, built as `make dist` does."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("dist")
    how = ["--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(folder)]
    built = [str(REPO), *map(str, PLUGINS)]
    subprocess.run([*PIP, "wheel", *how, *built], check=True, timeout=240)
    assert len(list(folder.glob("*.whl"))) == len(built)
    return folder


def environment(folder: Path, wheels: list[Path]) -> Path:
    """The scripts of a new environment that has the wheels, and sees the dependencies here."""
    venv.create(folder, with_pip=False)
    target = next(folder.glob("lib/python3*/site-packages"))
    # Dependencies are seen, editable installs are not: .pth files of a path are not followed.
    here = next(path for path in sys.path if path.endswith("site-packages"))
    (target / "dependencies.pth").write_text(here + "\n")
    python = ["--python", str(folder / "bin" / "python")]
    how = ["--no-index", "--no-deps", "--ignore-installed"]
    subprocess.run([*PIP, *python, "install", *how, *map(str, wheels)], check=True, timeout=120)
    return folder / "bin"


@pytest.fixture(scope="module")
def installed(wheels: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the core alone."""
    core = list(wheels.glob("vrbench-*.whl"))
    return environment(tmp_path_factory.mktemp("core") / "env", core)


def in_it(installed: Path, *command: str, plugins: str = "", path: str = "") -> str:
    """What a command prints in a new environment, which sees no checkout; of plugins only these."""
    told = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [str(installed / command[0]), *command[1:]],
        cwd=installed,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**told, "VRBENCH_PLUGINS": plugins} | ({"PYTHONPATH": path} if path else {}),
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


def entry_of(folder: Path) -> tuple[str, str]:
    """Entry point and distribution of a plugin."""
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    ((name, _),) = project["entry-points"]["vrbench"].items()
    return name, project["name"]


def test_all_wheels_install_together_and_none_is_broken(wheels: Path, tmp_path: Path) -> None:
    bin_ = environment(tmp_path / "env", sorted(wheels.glob("*.whl")))
    names = [entry_of(folder)[0] for folder in PLUGINS]
    listed = in_it(bin_, "vrbench", "plugin", "list", plugins=",".join(names))
    assert "broken" not in listed
    for name in names:
        assert name in listed
    where = in_it(bin_, "python", "-c", "import vrbench_quest; print(vrbench_quest.__file__)")
    assert str(tmp_path) in where


@pytest.mark.parametrize("folder", PLUGINS, ids=lambda path: path.name)
def test_every_plugin_works_alone_with_the_core(
    folder: Path, installed: Path, wheels: Path, tmp_path: Path
) -> None:
    name, distribution = entry_of(folder)
    (wheel,) = wheels.glob(f"{distribution.replace('-', '_')}-*.whl")
    # a wheel of pure Python is what it unpacks to
    zipfile.ZipFile(wheel).extractall(tmp_path)
    code = (
        "from vrbench.plugin.manager import Plugins; p = Plugins();"
        "print([(i.name, i.broken) for i in p.infos][1:])"
    )
    told = in_it(installed, "python", "-c", code, plugins=name, path=str(tmp_path))
    assert told.strip() == f"[({name!r}, None)]"


def test_it_has_the_templates_of_plugins(installed: Path, tmp_path: Path) -> None:
    in_it(installed, "vrbench", "plugin", "new", "suite", "mine", "-o", str(tmp_path))
    assert (tmp_path / "vrbench-mine" / "vrbench_mine" / "mine.yaml").is_file()


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
