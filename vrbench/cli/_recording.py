"""What `run` and `record` share: their options, and a suite's recording at the terminal."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from vrbench.cli._progress import RunDisplay
from vrbench.cli._tables import bar, console, show_table
from vrbench.errors import ConfigError, VrbenchError

if TYPE_CHECKING:
    from vrbench.config.rig import Rig
    from vrbench.config.suite import Suite
    from vrbench.devices.permit import Permit
    from vrbench.plugin.manager import Plugins
    from vrbench.results.bundle import Bundle
    from vrbench.running.permission import Permission


@dataclass(frozen=True, slots=True)
class Asked:
    """What the command line asked to be recorded; attributes as the options' help says."""

    suite: str
    rig: str
    output: Path | None
    execute: str | None
    resume: bool
    calibration: Path | None
    yes: bool
    seed: int | None
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
        "--resume",
        is_flag=True,
        help="Go on with the run in -o: only what isn't whole is recorded.",
    ),
    click.option(
        "--calibration",
        metavar="RUN",
        type=click.Path(path_type=Path),
        help="Begin with the calibration that ended RUN: nobody has touched the headset since.",
    ),
    click.option(
        "--yes", is_flag=True, help="Take the operator's work for done; no robot moves by this."
    ),
    click.option(
        "--seed",
        type=click.IntRange(min=0),
        help="Of everything random [1].",
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


def record(asked: Asked) -> Bundle:
    """Records a suite on a rig.

    A real robot moves only where `--execute` names the run's plans; a person's motion needs what
    was agreed with them.
    """
    from vrbench.cli._person import ScriptedOperator, TerminalOperator, TerminalPerson
    from vrbench.config.rig import load_rig
    from vrbench.config.suite import load_suite
    from vrbench.plugin.manager import Plugins, families_of
    from vrbench.results.bundle import default_folder
    from vrbench.runner import record_suite

    plugins = Plugins()
    suite = load_suite(asked.suite, dict(plugins.suites))
    families_of(suite, plugins, asked.suite)
    rig = load_rig(asked.rig)
    if asked.resume and asked.output is None:
        raise ConfigError("which run is to be gone on with?", field="--resume", fix="-o RUN")
    if asked.resume and asked.calibration is not None:
        raise ConfigError(
            "a run that is gone on with has its calibration",
            field="--calibration",
            fix="leave it out",
        )
    folder = asked.output or default_folder(suite.suite, rig.headset.model)
    person = TerminalPerson()
    with RunDisplay(f"record {suite.label} on {rig.headset.model}", console(err=True)) as display:
        allowed = _permission(suite, rig, plugins, asked, display)
        try:
            return record_suite(
                suite,
                rig,
                asked.rig,
                folder,
                plugins,
                watcher=person if suite.mover == "person" else display,
                seed=asked.seed,
                operator=ScriptedOperator() if asked.yes else TerminalOperator(display.paused),
                person=person,
                permission=allowed,
                licence=asked.licence,
                consent=asked.consent,
                resume=asked.resume,
                calibration=asked.calibration,
            )
        except VrbenchError:
            display.close()
            _show_what_is_there(folder)
            raise


def _show_what_is_there(folder: Path) -> None:
    """Where a run that didn't end well is, and how to go on with it."""
    from vrbench.results.bundle import Bundle
    from vrbench.results.lock import locked
    from vrbench.results.record import RECORD

    if (folder / RECORD).is_file():
        try:
            with locked(folder):
                pass
        except ConfigError:  # another process records into it
            return
        record = Bundle.begun(folder).record
        if record.status != "complete":
            click.echo(f"run: {folder} ({record.status}; --resume goes on with it)", err=True)


def _permission(
    suite: Suite, rig: Rig, plugins: Plugins, asked: Asked, display: RunDisplay
) -> Permission | None:
    """Plans a real robot's motions, shows them, and checks `--execute`; None for simulated ones."""
    from vrbench.devices.permit import confirm
    from vrbench.running.permission import permission, plan_suite

    with bar(f"plan {suite.label}") as tell:
        planned = plan_suite(suite, rig, asked.rig, plugins, tell)
    if planned is None:
        if asked.execute is not None:
            raise ConfigError("no real robot moves on this rig", file=asked.rig, field="--execute")
        return None
    for (name, speed), plan in planned.plans.items():
        rows = [[what, value] for what, value in planned.planner.describe(plan)]
        show_table(f"Plan of {name} at speed {speed:g}", ["", ""], rows)

    def ask(robot: str, plans: list[str], permit: Permit) -> None:
        with display.paused():
            confirm(robot, plans, permit)

    return permission(planned, asked.execute, ask)
