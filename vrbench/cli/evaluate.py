"""`vrbench evaluate`: takes -> metrics."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from vrbench.cli._cluster import Tls

if TYPE_CHECKING:
    from vrbench.batch.unit import Outcome, Unit
    from vrbench.cli._evaluated import Watching

FILE = click.Path(path_type=Path, exists=True, dir_okay=False)


@click.command(epilog="Example: vrbench evaluate runs/*")
@click.argument("runs", nargs=-1, required=True)
@click.option("--protocol", default="vrbench-1", show_default=True, help="How takes are scored.")
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    help="So many runs at a time, each in a process of its own.",
)
@click.option("--no-cache", is_flag=True, help="Compute everything anew, and keep nothing of it.")
@click.option("--scheduler", metavar="URL", help="Have a dask cluster do it: tcp://HOST:PORT.")
@click.option("--tls-ca", type=FILE, help="With tls://...: certificates of the authority.")
@click.option("--tls-cert", type=FILE, help="The client's own certificate.")
@click.option("--tls-key", type=FILE, help="And its key.")
def command(
    runs: tuple[str, ...],
    protocol: str,
    jobs: int | None,
    no_cache: bool,
    scheduler: str | None,
    tls_ca: Path | None,
    tls_cert: Path | None,
    tls_key: Path | None,
) -> None:
    """Score the takes of RUNS and write their metric tables.

    RUNS are folders, or URLs that fsspec opens. A run that fails doesn't stop the others; one that
    is named twice is evaluated once.
    """
    from vrbench.batch.places import is_url
    from vrbench.batch.pool import perform_all
    from vrbench.batch.unit import Unit, check_jobs
    from vrbench.cli._evaluated import Watching, show_outcomes
    from vrbench.cli._tables import bar
    from vrbench.errors import ConfigError

    check_jobs(jobs or 1)
    if jobs is not None and scheduler is not None:
        fix = "the cluster's workers and threads say how many runs go on at a time"
        raise ConfigError("stands beside --scheduler", field="--jobs", fix=fix)
    tls = Tls(tls_ca, tls_cert, tls_key)
    if scheduler is None and tls != Tls():
        raise ConfigError("is for a scheduler's connection", field="--tls-...", fix="--scheduler")
    named: dict[str, str] = {}
    for run in runs:
        named.setdefault(run if is_url(run) else str(Path(run).resolve()), run)
    units = [Unit(run, run, protocol, cached=not no_cache) for run in named.values()]
    done: dict[str, Outcome] = {}
    with bar("evaluate") as tell:
        watching = Watching(units, tell)
        if scheduler is not None:
            outcomes = _by_cluster(units, scheduler, tls)
        elif jobs is not None:
            outcomes = perform_all(units, jobs, watching.goes_on)
        else:
            outcomes = _here(units, watching)
        for outcome in outcomes:
            watching.ended(outcome)
            done[outcome.unit.name] = outcome
    sys.exit(show_outcomes([done[unit.name] for unit in units]))


def _here(units: Sequence[Unit], watching: Watching) -> Iterator[Outcome]:
    """One unit after the other, in this process."""
    from vrbench.batch.unit import perform
    from vrbench.plugin.manager import Plugins

    plugins = Plugins()
    for unit in units:
        yield perform(unit, partial(watching.goes_on, unit), plugins)


def _by_cluster(units: Sequence[Unit], address: str, tls: Tls) -> Iterator[Outcome]:
    from vrbench.batch.unit import as_seen_here
    from vrbench.cli._cluster import cluster, perform_there, refuse_unlike

    with cluster(address, tls) as client:
        build = refuse_unlike(client)
        yield from perform_there(client, address, [as_seen_here(unit, build) for unit in units])
