"""How the evaluation of many runs is shown: what goes on, what came of each, what failed."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import click

from vrbench.cli._tables import console, exit_code, show_metrics, show_trouble

if TYPE_CHECKING:
    from vrbench.batch.unit import Outcome, Unit


class Watching:
    """What is told while runs are evaluated, and how far all of them together are.

    On a terminal it is a bar, in a pipe a line for each run that has ended, if there are several.
    """

    def __init__(self, units: Sequence[Unit], tell: Callable[[str, float], None]) -> None:
        self._parts = {unit.name: 0.0 for unit in units}
        self._tell = tell
        self._ended = 0
        self._started = time.monotonic()

    def goes_on(self, unit: Unit, what: str, part: float) -> None:
        """A unit does something."""
        self._parts[unit.name] = part
        self._tell(f"{unit.name} {what}", self._part)

    def ended(self, outcome: Outcome) -> None:
        """A unit came to its end."""
        self._parts[outcome.unit.name] = 1.0
        self._ended += 1
        self._tell(outcome.unit.name, self._part)
        if len(self._parts) > 1:
            state = f"failed: {outcome.error}" if outcome.error else "evaluated"
            place = f"{self._ended} of {len(self._parts)}"
            text = f"{place}: {outcome.unit.name} {state}{self._left()}"
            console(err=True).print(text, soft_wrap=True)

    def _left(self) -> str:
        """How long it still takes, as the text of a line; nothing when all is done."""
        if self._ended == len(self._parts):
            return ""
        left_s = (time.monotonic() - self._started) * (1.0 - self._part) / self._part
        return f", about {left_s // 60:.0f}:{left_s % 60:02.0f} left"

    @property
    def _part(self) -> float:
        return sum(self._parts.values()) / len(self._parts)


def show_outcomes(outcomes: Sequence[Outcome]) -> int:
    """Prints what came of each run, and in the end which failed; returns the exit code."""
    code = 0
    for outcome in outcomes:
        name = outcome.unit.name
        if outcome.error is None:
            show_metrics(outcome.rows, f"{name}/metrics/{outcome.unit.protocol}.csv")
            show_trouble(outcome.rows)
            click.echo(f"run: {name}")
            code = max(code, exit_code(outcome.rows))
        else:
            code = max(code, outcome.error.exit_code)
    failed = [outcome for outcome in outcomes if outcome.error is not None]
    if len(outcomes) > 1:
        click.echo(f"evaluated {len(outcomes) - len(failed)} of {len(outcomes)} runs", err=True)
    for outcome in failed:
        name, told = outcome.unit.name, str(outcome.error)
        click.echo(f"error: {told}" if name in told else f"error: {name}: {told}", err=True)
    return code
