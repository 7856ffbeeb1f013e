"""`vrbench verify`: whether runs are what they say."""

from __future__ import annotations

import sys
from pathlib import Path

import click


@click.command(epilog="Example: vrbench verify runs/mine; in CI: vrbench verify --folder results")
@click.argument("runs", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--folder", type=click.Path(path_type=Path), help="All runs of a folder, at LAB/SUITE/RUN."
)
def command(runs: tuple[Path, ...], folder: Path | None) -> None:
    """Check RUNS: every file's digest, and every number by evaluating the takes again.

    Numbers may be off by 1e-6 of themselves or by 1e-4 of their unit. Prints one line for
    everything that is wrong; the exit code is 1 if anything is.
    """
    from vrbench.cli._tables import bar
    from vrbench.errors import ConfigError
    from vrbench.plugin.manager import Plugins
    from vrbench.results.board_formats import one_line
    from vrbench.verification import Finding, summary, verify_folder, verify_run

    if bool(runs) == bool(folder):
        raise ConfigError("give runs, or --folder with a folder of runs", field="RUN")
    plugins = Plugins()
    found: list[Finding] = []
    every = list(runs)
    with bar("verify") as show:

        def tell(run: str, what: str) -> None:
            show(f"{run} {what}", 0.0)

        if folder is not None:
            every, found = verify_folder(folder, plugins, tell)
        for run in runs:
            found += verify_run(run, plugins, tell)
    for finding in found:
        click.echo(one_line(str(finding)), err=True)
    click.echo(summary(every, found))
    sys.exit(1 if found else 0)
