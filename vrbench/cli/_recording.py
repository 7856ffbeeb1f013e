"""What `run` and `record` share: their options, and a suite's recording at the terminal."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from vrbench.cli._tables import bar, show_table
from vrbench.errors import ConfigError

if TYPE_CHECKING:
    from vrbench.config.rig import Rig
    from vrbench.config.suite import Suite
    from vrbench.permission import Permission
    from vrbench.plugin.manager import Plugins
    from vrbench.results.bundle import Bundle


@dataclass(frozen=True, slots=True)
class Asked:
    """What the command line asked to be recorded; attributes as the options' help says."""

    suite: str
    rig: str
    output: Path | None
    execute: str | None
    seed: int
    licence: str | None
    consent: str | None


_OPTIONS = (
    click.argument("suite"),
    click.option("--rig", required=True, help="A rig file, or sim:DEVICE for a simulated one."),
    click.option(
        *("-o", "--output"),
        type=click.Path(path_type=Path),
        help="The new run's folder [runs/...].",
    ),
    click.option("--execute", metavar="HASH", help="Move a real robot by the plans of this hash."),
    click.option(
        "--seed",
        type=click.IntRange(min=0),
        default=1,
        show_default=True,
        help="Of everything random.",
    ),
    click.option("--licence", help="Of a person's motion: under which it may be used."),
    click.option("--consent", help="Of a person's motion: how they agreed to that."),
)


def recording(act: Callable[[Asked], None]) -> Callable[..., None]:
    """Gives a verb the arguments and options of all verbs that record, gathered into one."""

    @functools.wraps(act)
    def verb(**given: Any) -> None:
        act(Asked(**given))

    for option in reversed(_OPTIONS):
        verb = option(verb)
    return verb


class _Bar:
    """Shows a run's progress: the take, its poses by stream, and the whole."""

    def __init__(self, tell: Any) -> None:
        self._tell = tell
        self._name, self._index, self._total = "", 0, 1

    def take(self, name: str, index: int, total: int) -> None:
        self._name, self._index, self._total = name, index, total
        self._tell(name, index / total)

    def moving(self, received: Mapping[str, int], done: float) -> None:
        counts = ", ".join(f"{stream} {n}" for stream, n in received.items())
        self._tell(f"{self._name}  {counts}", (self._index + done) / self._total)


def record(asked: Asked) -> Bundle:
    """Records a suite on a rig.

    A real robot moves only where `--execute` names the run's plans; a person's motion needs what
    was agreed with them.
    """
    from vrbench.cli._person import TerminalOperator, TerminalPerson
    from vrbench.config.rig import load_rig
    from vrbench.config.suite import load_suite
    from vrbench.plugin.manager import Plugins, families_of
    from vrbench.results.bundle import default_folder
    from vrbench.runner import record_suite

    plugins = Plugins()
    suite = load_suite(asked.suite, dict(plugins.suites))
    families_of(suite, plugins, asked.suite)
    rig = load_rig(asked.rig)
    folder = asked.output or default_folder(suite.suite, rig.headset.model)
    person = TerminalPerson()
    run = functools.partial(
        record_suite,
        *(suite, rig, asked.rig, folder, plugins),
        seed=asked.seed,
        operator=TerminalOperator(),
        person=person,
        permission=_permission(suite, rig, plugins, asked),
        licence=asked.licence,
        consent=asked.consent,
    )
    if suite.mover == "person":
        return run(watcher=person)
    with bar(f"record {suite.label} on {rig.headset.model}") as tell:
        return run(watcher=_Bar(tell))


def _permission(suite: Suite, rig: Rig, plugins: Plugins, asked: Asked) -> Permission | None:
    """Plans a real robot's motions, shows them, and checks `--execute`; None for simulated ones."""
    from vrbench.permission import permission, plan_suite

    with bar(f"plan {suite.label}") as tell:
        planned = plan_suite(suite, rig, asked.rig, plugins, tell)
    if planned is None:
        if asked.execute is not None:
            raise ConfigError("no real robot moves on this rig", file=asked.rig, field="--execute")
        return None
    for (name, speed), plan in planned.plans.items():
        rows = [[what, value] for what, value in planned.planner.describe(plan)]
        show_table(f"Plan of {name} at speed {speed:g}", ["", ""], rows)
    return permission(planned, asked.execute)
