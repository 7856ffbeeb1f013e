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
@click.option("--licence", help="Of a person's motion: under which it may be used.")
@click.option("--consent", help="Of a person's motion: how they agreed to that.")
def command(
    suite: str,
    rig: str,
    output: Path | None,
    execute: str | None,
    seed: int,
    licence: str | None,
    consent: str | None,
) -> None:
    """Record SUITE on a rig; `vrbench evaluate` scores it later."""
    from vrbench.cli._steps import record, show_runs

    bundle = record(suite, rig, output, seed, execute, licence=licence, consent=consent)
    show_runs([bundle])
