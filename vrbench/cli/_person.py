"""The person at the terminal, who wears the headset while a suite is recorded."""

from __future__ import annotations

import sys
import threading
from collections.abc import Generator
from typing import TYPE_CHECKING

import click

from vrbench.errors import ConfigError

if TYPE_CHECKING:
    from vrbench.config.suite import Step
    from vrbench.devices.ports import Session

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

    def moving(self, received: object, done: float) -> None:
        """Nothing is shown while a person moves: they read no terminal."""


class TerminalOperator:
    """Fixes the headset anew when the terminal asks for it."""

    def remount(self, mount: int) -> None:
        """Waits for Enter.

        Raises:
            ConfigError: nobody is there to press it.
        """
        click.echo(f"Fix the headset anew, the {mount}. time. Enter goes on ", nl=False)
        if not sys.stdin.readline():
            raise ConfigError(
                "the headset must be fixed anew, and nobody is at the terminal",
                fix="run it at a terminal",
            )
