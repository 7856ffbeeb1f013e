"""`vrbench run`: record a suite on a rig, then evaluate it."""

from __future__ import annotations

import sys

import click

from vrbench.cli._recording import Asked, record, recording


@click.command(epilog="Example: vrbench run gameplay-replay --rig sim:quest-pro -o my-run")
@recording
def command(asked: Asked) -> None:
    """Record SUITE on a rig, evaluate it, print its metrics and write its report."""
    from vrbench.cli._steps import PROTOCOL, evaluate_run, metric_table, report_run, show_runs
    from vrbench.cli._tables import exit_code, show_metrics, show_trouble

    bundle = record(asked)
    rows = evaluate_run(bundle, PROTOCOL)
    show_metrics(rows, metric_table(bundle, PROTOCOL))
    show_trouble(rows)
    show_runs([bundle])
    report_run(bundle, PROTOCOL)
    sys.exit(exit_code(rows))
