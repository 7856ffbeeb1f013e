"""`vrbench evaluate`: takes -> metrics."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from vrbench.batch.unit import Outcome, Unit
    from vrbench.cli._evaluated import Watching


@click.command(epilog="Example: vrbench evaluate runs/*")
@click.argument("runs", nargs=-1, required=True)
@click.option("--protocol", default="vrbench-1", show_default=True, help="How takes are scored.")
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    help="So many runs at a time, each in a process of its own.",
)
def command(runs: tuple[str, ...], protocol: str, jobs: int | None) -> None:
    """Score the takes of RUNS and write their metric tables.

    A run that fails doesn't stop the others. A run that is named twice is evaluated once.
    """
    from vrbench.batch.unit import Unit, check_jobs
    from vrbench.cli._evaluated import Watching, show_outcomes
    from vrbench.cli._tables import bar

    check_jobs(jobs or 1)
    named: dict[Path, str] = {}
    for run in runs:
        named.setdefault(Path(run).resolve(), run)
    units = [Unit(run, run, protocol) for run in named.values()]
    done: dict[str, Outcome] = {}
    with bar("evaluate") as tell:
        watching = Watching(units, tell)
        for outcome in _performed(units, jobs, watching):
            watching.ended(outcome)
            done[outcome.unit.run] = outcome
    sys.exit(show_outcomes([done[unit.run] for unit in units]))


def _performed(units: Sequence[Unit], jobs: int | None, watching: Watching) -> Iterator[Outcome]:
    """The outcomes, as they come: of a pool where one is asked for, else of this process."""
    from functools import partial

    from vrbench.batch.pool import perform_all
    from vrbench.batch.unit import perform
    from vrbench.plugin.manager import Plugins

    if jobs is not None:
        yield from perform_all(units, jobs, watching.goes_on)
        return
    plugins = Plugins()
    for unit in units:
        yield perform(unit, partial(watching.goes_on, unit), plugins)
