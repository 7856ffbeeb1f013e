"""`vrbench run`: record a suite on a rig, then evaluate it."""

from __future__ import annotations

import sys
from pathlib import Path

import click


@click.command(epilog="Example: vrbench run gameplay-replay --rig sim:quest-pro -o my-run")
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
    """Record SUITE on a rig, evaluate it, print its metrics and write its report."""
    from vrbench.cli._steps import (
        PROTOCOL,
        evaluate_run,
        metric_table,
        record,
        report_run,
        show_runs,
    )
    from vrbench.cli._tables import exit_code, show_metrics, show_trouble

    bundle = record(suite, rig, output, seed, execute)
    rows = evaluate_run(bundle, PROTOCOL)
    show_metrics(rows, metric_table(bundle, PROTOCOL))
    show_trouble(rows)
    show_runs([bundle])
    report_run(bundle, PROTOCOL)
    sys.exit(exit_code(rows))
