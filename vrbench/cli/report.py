"""`vrbench report`: a run as a page of HTML."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(epilog="Example: vrbench report runs/my-run")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--protocol", default="vrbench-1", show_default=True, help="How takes were scored.")
def command(runs: tuple[Path, ...], protocol: str) -> None:
    """Write report.html into RUNS: results, plots, calibration, verdicts and provenance.

    It is one file that needs no network. Its plots are drawn from what `vrbench evaluate` kept.
    """
    from vrbench.protocols.registry import find_protocol
    from vrbench.results.bundle import Bundle
    from vrbench.results.report.run_page import REPORT, write_report

    find_protocol(protocol)
    for folder in runs:
        write_report(Bundle.open(folder), protocol)
        click.echo(f"report: {folder / REPORT}")
