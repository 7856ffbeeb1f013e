"""The person at the terminal, who wears the headset while a suite is recorded."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING

import click

from vrbench.errors import ConfigError

if TYPE_CHECKING:
    from vrbench.config.suite import Step
    from vrbench.devices.ports import Occlusion, Session
    from vrbench.recording.monitor import Progress

LOOK_S = 0.1
HOW = {
    "calibration": "turn and move the headset by hand, slowly, about and along all axes, for 90 s",
    "scored": "play, or move as you like",
}


class TerminalPerson:
    """Begins and ends takes with the Enter key."""

    def ready(self, step: Step) -> None:
        """Says what to do, and waits for Enter.

        Raises:
            ConfigError: nobody is there to press it.
        """
        click.echo(f"{step.name}: {HOW.get(step.case.role, HOW['scored'])}.")
        click.echo("  Enter begins ", nl=False)
        if not sys.stdin.readline():
            raise ConfigError(
                "a person begins and ends takes, and nobody is at the terminal",
                fix="run it at a terminal, or import recordings",
            )

    def perform(self, step: Step, session: Session) -> Generator[float, None, None]:  # noqa: ARG002
        """Goes on until Enter."""
        click.echo("  recording; Enter ends ", nl=False)
        done = threading.Event()

        def wait() -> None:
            sys.stdin.readline()
            done.set()

        threading.Thread(target=wait, daemon=True).start()
        while not done.is_set():
            session.host.wait(LOOK_S)
            yield 0.0
        yield 1.0

    def take(self, name: str, index: int, total: int) -> None:
        """A take begins; told by `ready`."""

    def moving(self, progress: Progress) -> None:
        """Nothing is shown while a person moves: they read no terminal."""

    def notice(self, text: str) -> None:
        """Something that they should know later."""
        click.echo(text, err=True)


class TerminalOperator:
    """Does by hand what the terminal asks for.

    Args:
        paused: within it, nothing else writes to the terminal.
    """

    def __init__(self, paused: Callable[[], AbstractContextManager[None]] = nullcontext) -> None:
        self._paused = paused

    def remount(self, mount: int) -> None:
        """Waits for Enter.

        Raises:
            ConfigError: nobody is there to press it.
        """
        with self._paused():
            _asked(f"Fix the headset anew, the {mount}. time.")

    def cover(self, occlusion: Occlusion) -> None:
        """Waits for Enter; raises as `remount`."""
        with self._paused():
            _asked(f"{_covering(occlusion)}.")

    def recentre(self) -> None:
        """Says it, and waits for nothing: the robot may be moving."""
        click.echo("Recentre the headset now, by its controller, from outside the robot's reach.")


class ScriptedOperator:
    """For `--yes`: says what would be asked for, and takes it for done.

    It stands in where nobody is needed, as with emulated devices. It never lets a robot move.
    """

    def remount(self, mount: int) -> None:
        click.echo(f"taken for done: the headset is fixed anew, the {mount}. time", err=True)

    def cover(self, occlusion: Occlusion) -> None:
        click.echo(f"taken for done: {_covering(occlusion).lower()}", err=True)

    def recentre(self) -> None:
        click.echo("taken for done: the headset is recentred", err=True)


def _covering(occlusion: Occlusion) -> str:
    if not occlusion.share:
        return "Uncover all cameras"
    if occlusion.share == 1.0:
        return "Cover all cameras"
    names = ", ".join(f"{id_} ({name})" for id_, name in sorted(occlusion.cameras.items()))
    return f"Cover cameras {names}, uncover all others"


def _asked(what: str) -> None:
    """Waits for Enter.

    Raises:
        ConfigError: nobody is there to press it.
    """
    click.echo(f"{what} Enter goes on ", nl=False)
    if not sys.stdin.readline():
        raise ConfigError(
            f"nobody is at the terminal to do this: {what}",
            fix="run it at a terminal; --yes takes it for done",
        )
