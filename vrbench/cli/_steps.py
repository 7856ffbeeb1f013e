"""What several verbs do: record a suite, evaluate runs, with progress on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from vrbench.cli._tables import bar, show_table
from vrbench.errors import ConfigError

if TYPE_CHECKING:
    from vrbench.config.rig import Rig
    from vrbench.config.suite import Suite
    from vrbench.permission import Permission
    from vrbench.plugin.manager import Plugins
    from vrbench.results.bundle import Bundle
    from vrbench.results.tables import Row

PROTOCOL = "vrbench-1"


class _Bar:
    """Shows a run's progress: the take, its poses by stream, and the whole."""

    def __init__(self, tell: Any) -> None:
        self._tell = tell
        self._name, self._index, self._total = "", 0, 1

    def take(self, name: str, index: int, total: int) -> None:
        self._name, self._index, self._total = name, index, total
        self._tell(name, index / total)

    def moving(self, received: Mapping[str, int], done: float) -> None:
        counts = ", ".join(f"{stream} {n}" for stream, n in received.items())
        self._tell(f"{self._name}  {counts}", (self._index + done) / self._total)


def record(
    suite_name: str,
    rig_name: str,
    output: Path | None,
    seed: int,
    execute: str | None = None,
    *,
    licence: str | None = None,
    consent: str | None = None,
) -> Bundle:
    """Records a suite on a rig.

    A real robot moves only where `execute` names the run's plans; a person's motion needs what was
    agreed with them.
    """
    from vrbench.capture import record_capture
    from vrbench.cli._person import TerminalOperator, TerminalPerson
    from vrbench.config.rig import load_rig
    from vrbench.config.suite import load_suite
    from vrbench.plugin.manager import Plugins, families_of
    from vrbench.results.bundle import default_folder
    from vrbench.runner import record_suite

    plugins = Plugins()
    suite = load_suite(suite_name, dict(plugins.suites))
    families_of(suite, plugins, suite_name)
    rig = load_rig(rig_name)
    folder = output or default_folder(suite.suite, rig.headset.model)
    if suite.mover == "person":
        person = TerminalPerson()
        return record_capture(
            suite,
            rig,
            rig_name,
            folder,
            plugins,
            person=person,
            seed=seed,
            watcher=person,
            licence=licence,
            consent=consent,
        )
    allowed = _permission(suite, rig, rig_name, plugins, execute)
    with bar(f"record {suite.label} on {rig.headset.model}") as tell:
        return record_suite(
            *(suite, rig, rig_name, folder, plugins),
            seed=seed,
            watcher=_Bar(tell),
            operator=TerminalOperator(),
            permission=allowed,
        )


def _permission(
    suite: Suite, rig: Rig, rig_name: str, plugins: Plugins, execute: str | None
) -> Permission | None:
    """Plans a real robot's motions, shows them, and checks `--execute`; None for simulated ones."""
    from vrbench.permission import permission, plan_suite

    with bar(f"plan {suite.label}") as tell:
        planned = plan_suite(suite, rig, rig_name, plugins, tell)
    if planned is None:
        if execute is not None:
            raise ConfigError("no real robot moves on this rig", file=rig_name, field="--execute")
        return None
    for (name, speed), plan in planned.plans.items():
        rows = [[what, value] for what, value in planned.planner.describe(plan)]
        show_table(f"Plan of {name} at speed {speed:g}", ["", ""], rows)
    return permission(planned, execute)


def evaluate_run(bundle: Bundle, protocol: str, plugins: Plugins | None = None) -> list[Row]:
    """Evaluates a run by a protocol."""
    from vrbench.evaluation import evaluate
    from vrbench.plugin.manager import Plugins, families_of, pick
    from vrbench.protocols.registry import builtin_protocols

    plugins = plugins or Plugins()
    protocols = {found.name: found for found in builtin_protocols()}
    chosen = pick(protocols, protocol, "protocol", field="--protocol", file=None)
    suite = bundle.record.resolved_suite()
    families = chosen.families or families_of(suite, plugins, str(bundle.folder))
    with bar(f"evaluate {bundle.folder.name}") as tell:
        return evaluate(bundle, families, chosen, lambda name, i, total: tell(name, i / total))


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
