"""How conformance reports look at a terminal."""

from __future__ import annotations

import click

from vrbench.plugin.report import Report

MARKS = {"passed": "ok    ", "failed": "FAILED", "not checked": "-     "}


def show_report(report: Report) -> None:
    """A line a check; below what failed, what to do; at the end why some weren't checked."""
    click.echo(f"{report.kind} {report.name} ({report.distribution} {report.version})")
    for outcome in report.outcomes:
        click.echo(f"  {MARKS[outcome.status]} {outcome.title}")
        if outcome.status == "failed":
            click.echo(f"           {outcome.what}")
            click.echo(f"           {outcome.fix}")
    found = [outcome.status for outcome in report.outcomes]
    told = [f"{found.count(each)} {each}" for each in ("passed", "failed", "not checked")]
    click.echo(f"  {', '.join(told)}")
    reasons = {x.what: x.fix for x in report.outcomes if x.status == "not checked"}
    for what, fix in reasons.items():
        click.echo(f"  not checked: {what}: {fix}")
    click.echo("")
