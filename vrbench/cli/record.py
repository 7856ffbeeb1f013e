"""`vrbench record`: record a suite on a rig, without evaluating it."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(epilog="Example: vrbench record calibration --rig sim -o my-run")
@click.argument("suite")
@click.option("--rig", required=True, help="A rig file, or sim:DEVICE for a simulated one.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="The new run's folder [runs/...]."
)
@click.option("--execute", metavar="HASH", help="Move a real robot by the plans of this hash.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="Of everything random.",
)
def command(suite: str, rig: str, output: Path | None, execute: str | None, seed: int) -> None:
    """Record SUITE on a rig; `vrbench evaluate` scores it later."""
    from vrbench.cli._steps import record, show_runs

    show_runs([record(suite, rig, output, seed, execute)])
