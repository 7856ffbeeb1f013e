"""`vrbench suite`: what can be run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from vrbench.config.suite import Step, Suite


@click.group()
def command() -> None:
    """Suites: list, show and check them."""


@command.command("list")
def list_() -> None:
    """List the suites there are, by name and version."""
    from vrbench.cli._tables import show_table
    from vrbench.config.suite import load_suite
    from vrbench.plugin.manager import Plugins

    others = dict(Plugins().suites)
    rows = []
    for name in others:
        suite = load_suite(name, others)
        takes = sum(1 for _ in suite.schedule())
        rows.append([suite.label, suite.title, str(takes), ", ".join(suite.metrics)])
    show_table("Suites", ["suite", "title", "takes ", "metrics"], rows)


@command.command("show")
@click.argument("suite")
def show(suite: str) -> None:
    """Print SUITE with all it extends resolved, its digest, and its takes in order."""
    from vrbench.config.suite import load_suite
    from vrbench.config.yaml_file import as_yaml
    from vrbench.plugin.manager import Plugins

    found = load_suite(suite, dict(Plugins().suites))
    click.echo(as_yaml(found.canonical()).rstrip())
    click.echo(f"# digest: {found.digest}")
    for step in found.schedule():
        click.echo(f"# take: {step.name}, {_told(step, found)}")


@command.command("check")
@click.argument("suite")
def check(suite: str) -> None:
    """Say whether SUITE, a file or a name, can be run: its fields, motions and metrics."""
    from vrbench.config.ranking import never_ranked
    from vrbench.config.suite import load_suite
    from vrbench.plugin.manager import Plugins, families_of
    from vrbench.running.feasibility import check_feasible

    plugins = Plugins()
    found = load_suite(suite, dict(plugins.suites))
    if found.mover == "robot":
        for motion in found.motions:
            found.motion(motion)
    check_feasible(found, suite)
    families_of(found, plugins, suite)
    click.echo(f"{found.label} is sound: {sum(1 for _ in found.schedule())} takes")
    for why in never_ranked(found):
        click.echo(f"no rank: {why}")


def _told(step: Step, suite: Suite) -> str:
    """How a take's motion is run."""
    case = step.case
    told = [suite.motions[case.motion].split()[0]]
    if case.speed != 1.0:
        told.append(f"speed {case.speed:g}")
    if case.loops > 1:
        told.append(f"{case.loops} loops")
    if case.duration is not None:
        told.append(f"loops for {case.duration / 60:g} min")
    if case.hold:
        told.append(f"hold {case.hold:g} s")
    if case.occlude != "none":
        told.append(f"cameras covered: {case.occlude}")
    return ", ".join(told)
