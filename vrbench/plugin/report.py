"""Conformance reports: what was checked of a plugin, and where the newest ones are kept."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import vrbench
from vrbench.errors import ConfigError
from vrbench.plugin.manager import KINDS, Plugins

if TYPE_CHECKING:
    from vrbench.plugin.testing.verdicts import Conformance, Outcome

VARIABLE = "VRBENCH_REPORTS"
SCHEMA = 1


@dataclass(frozen=True, slots=True)
class Report:
    """What was found of one thing that a plugin offers.

    Attributes:
        kind: `headset`, `importer`, ...
        name: of the thing.
        plugin: that offers it,
        distribution: that the plugin comes in,
        version: and its version.
        vrbench: version of vrbench.
        created: when, UTC.
        outcomes: of every check.
    """

    kind: str
    name: str
    plugin: str
    distribution: str
    version: str
    vrbench: str
    created: str
    outcomes: list[Outcome]

    @property
    def passed(self) -> bool:
        """Whether nothing failed."""
        return all(outcome.status != "failed" for outcome in self.outcomes)

    def content(self) -> dict[str, Any]:
        """The report in JSON's types."""
        return {"schema": SCHEMA, "passed": self.passed, **asdict(self)}


def found(name: str, plugins: Plugins) -> list[tuple[str, str]]:
    """Kind and name of all that is meant by a name: a plugin's offers, or the things called so.

    Raises:
        ConfigError: nothing is; a broken plugin's reason is told.
    """
    infos = {info.name: info for info in plugins.infos}
    all_of = [(kind, thing) for kind in KINDS for thing in plugins.things(kind)]
    mine = [x for x in all_of if plugins.offered_by(*x).name == name]
    things = mine or [x for x in all_of if x[1] == name]
    if things:
        return things
    broken = infos[name].broken if name in infos else None
    if broken:
        raise ConfigError(f"plugin {name} is broken: {broken}", fix="mend that first")
    raise ConfigError(
        f"no plugin, and nothing that plugins offer, is called {name!r}",
        fix=f"plugins are {', '.join(infos)}; `vrbench plugin list` names what they offer",
    )


def check(kind: str, name: str, plugins: Plugins, recordings: str | None = None) -> Report:
    """Runs the conformance tests of one thing.

    Args:
        kind: what it is.
        name: what it is called.
        plugins: that offer it.
        recordings: a recordings file with logs of an importer's format, or the name of one.
    """
    info = plugins.offered_by(kind, name)
    return Report(
        kind=kind,
        name=name,
        plugin=info.name,
        distribution=info.distribution,
        version=info.version,
        vrbench=vrbench.__version__,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        outcomes=conformance(kind, plugins.things(kind)[name], name, recordings).run(),
    )


def conformance(
    kind: str, thing: Any, name: str, recordings: str | None = None
) -> type[Conformance]:
    """The tests of a kind, for the thing of this name."""
    from vrbench.plugin import testing

    bases: dict[str, type[Conformance]] = {
        "headset": testing.HeadsetConformance,
        "mocap": testing.MocapConformance,
        "robot": testing.RobotConformance,
        "importer": testing.ImporterConformance,
        "metric": testing.MetricConformance,
        "suite": testing.SuiteConformance,
    }
    base = bases[kind]
    if kind == "headset" and thing.open is None:
        base = testing.HeadsetModelConformance
    given = {"name": name} | ({"recordings": recordings} if kind == "importer" else {})
    return type(f"Test_{name}", (base,), given)


def folder() -> Path:
    """Where the newest reports are kept: what VRBENCH_REPORTS names, or the user's data folder."""
    named = os.environ.get(VARIABLE, "").strip()
    if named:
        return Path(named).expanduser()
    from platformdirs import user_data_path

    return user_data_path("vrbench", appauthor=False) / "conformance"


def keep(report: Report) -> Path:
    """Keeps a report as the newest of its thing."""
    path = folder() / f"{report.kind}-{report.name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(as_text([report]), encoding="utf-8")
    return path


def as_text(reports: Iterable[Report]) -> str:
    """Reports as JSON text."""
    return json.dumps([report.content() for report in reports], indent=1) + "\n"


def newest(things: Iterable[tuple[str, str]]) -> str | None:
    """The newest reports of these things as JSON text, kind and name; None where there are none."""
    kept = []
    for kind, name in things:
        path = folder() / f"{kind}-{name}.json"
        try:
            kept += json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
    return json.dumps(kept, indent=1) + "\n" if kept else None
