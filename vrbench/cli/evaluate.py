"""`vrbench evaluate`: takes -> metrics."""

from __future__ import annotations

import sys
from pathlib import Path

import click


@click.command(epilog="Example: vrbench evaluate runs/*")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--protocol", default="vrbench-1", show_default=True, help="How takes are scored.")
def command(runs: tuple[Path, ...], protocol: str) -> None:
    """Score the takes of RUNS and write their metric tables."""
    from vrbench.cli._steps import evaluate_run, metric_table, show_runs
    from vrbench.cli._tables import exit_code, show_metrics, show_trouble
    from vrbench.results.bundle import Bundle

    code = 0
    for folder in runs:
        bundle = Bundle.open(folder)
        rows = evaluate_run(bundle, protocol)
        show_metrics(rows, metric_table(bundle, protocol))
        show_trouble(rows)
        show_runs([bundle])
        code = max(code, exit_code(rows))
    sys.exit(code)
