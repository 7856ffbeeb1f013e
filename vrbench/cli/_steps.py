"""What several verbs do with runs: evaluate them, say where they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from vrbench.cli._tables import bar

if TYPE_CHECKING:
    from vrbench.results.bundle import Bundle
    from vrbench.results.tables import Row

PROTOCOL = "vrbench-1"


def evaluate_run(bundle: Bundle, protocol: str) -> list[Row]:
    """Evaluates a run by a protocol, here and now."""
    from vrbench.batch.unit import evaluate_bundle
    from vrbench.cache.store import Store
    from vrbench.results.lock import locked

    with bar(f"evaluate {bundle.folder.name}") as tell, locked(bundle.folder):
        return evaluate_bundle(bundle, protocol, tell, store=Store.usual())


def report_run(bundle: Bundle, protocol: str) -> None:
    """Writes a run's report; says so where what it needs isn't installed."""
    from importlib.util import find_spec

    if find_spec("jinja2") is None:
        click.echo("no report: it needs jinja2 (pip install 'vrbench[report]')", err=True)
        return
    from vrbench.results.report.run_page import REPORT, write_report

    write_report(bundle, protocol)
    click.echo(f"report: {bundle.folder / REPORT}")


def show_runs(bundles: Sequence[Bundle]) -> None:
    """Says where bundles are, and what to do next."""
    for bundle in bundles:
        click.echo(f"run: {bundle.folder}")


def metric_table(bundle: Bundle, protocol: str) -> str:
    """Where a run's metric table is."""
    return str(bundle.folder / "metrics" / f"{protocol}.csv")
