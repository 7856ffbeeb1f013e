"""Writes a new plugin: a distribution that installs and passes its tests at once."""

from __future__ import annotations

import keyword
import re
import shlex
import shutil
import sys
from pathlib import Path
from string import Template

from vrbench.errors import ConfigError
from vrbench.plugin.manager import KINDS, Plugins
from vrbench.plugin.sample import STREAM, write_sample

TEMPLATE = Path(__file__).with_name("template")
NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")


def scaffold(kind: str, name: str, parent: Path) -> Path:
    """A new distribution `vrbench-NAME` in a folder of that name.

    Args:
        kind: `headset`, `mocap`, `robot`, `importer`, `metric` or `suite`.
        name: what rigs, recordings and suites will call what it offers.
        parent: the folder that its folder is made in.

    Returns:
        its folder.

    Raises:
        ConfigError: the kind or the name is no good one or taken, or the folder exists.
    """
    if kind not in KINDS:
        raise ConfigError(f"no kind of plugin is {kind!r}", fix=f"there are {', '.join(KINDS)}")
    if not NAME.fullmatch(name) or len(name) > 40:
        raise ConfigError(
            f"{name!r} is no good name",
            fix="lower-case letters and digits, a letter first, joined by hyphens: pico4",
        )
    module = f"vrbench_{name.replace('-', '_')}"
    if module.partition("_")[2] in {*KINDS, "core"} or keyword.iskeyword(module):
        raise ConfigError(f"{name!r} says what it is and not which", fix="name the device: pico4")
    plugins = Plugins()
    offered = {kind: name, "importer": f"{name}-csv"} if kind in STREAM else {kind: name}
    for taken in (each for each in offered.items() if each[1] in plugins.things(each[0])):
        raise ConfigError(
            f"{' '.join(taken)} is there already, in {plugins.offered_by(*taken).distribution}",
            fix="another name",
        )
    if name in {info.name for info in plugins.infos}:
        raise ConfigError(f"a plugin called {name} is installed already", fix="another name")
    folder = parent / f"vrbench-{name}"
    if folder.exists():
        raise ConfigError("exists already", file=folder, fix="another name, or -o FOLDER")
    words = {
        "kind": kind,
        "name": name,
        "module": module,
        "title": name.replace("-", " ").capitalize(),
    }
    words["edit"] = _filled(TEMPLATE / kind / "edit.txt", words).strip()
    try:
        _write(kind, name, folder, words)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return folder


def _write(kind: str, name: str, folder: Path, words: dict[str, str]) -> None:
    """Fills the new folder."""
    package = folder / words["module"]
    for made in (package, folder / "tests", folder / "sample"):
        made.mkdir(parents=True)
    own = TEMPLATE / kind
    files = {
        folder / "pyproject.toml": TEMPLATE / "shared" / "pyproject.toml.in",
        folder / "README.md": TEMPLATE / "shared" / "README.md.in",
        package / "__init__.py": own / "module.py.in",
        folder / "tests" / f"test_{name.replace('-', '_')}.py": own / "test.py.in",
    }
    suite = "gameplay-replay"
    if kind == "metric":
        files[folder / "sample" / "suite.yaml"] = own / "suite.yaml.in"
        suite = "suite.yaml"
    elif kind == "suite":
        files[package / f"{name}.yaml"] = own / "suite.yaml.in"
        suite = name
    for path, template in files.items():
        path.write_text(_filled(template, words), encoding="utf-8")
    write_sample(kind, name, folder / "sample", suite)


def _filled(template: Path, words: dict[str, str]) -> str:
    return Template(template.read_text(encoding="utf-8")).substitute(words)


def steps(folder: Path, name: str) -> list[str]:
    """The commands that lead from a new plugin to a row on a leaderboard."""
    return [
        f"{Path(sys.executable).name} -m pip install --editable {shlex.quote(str(folder))}",
        f"vrbench import {shlex.quote(str(folder / 'sample/recordings.yaml'))} -o {name}-run",
        f"vrbench evaluate {name}-run",
        f"vrbench leaderboard {name}-run",
    ]
