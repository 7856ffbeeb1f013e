"""`vrbench rig`: the lab's devices."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from vrbench.cli._rig_check import Checked


@click.group()
def command() -> None:
    """Rigs: look at the lab's devices before anything is recorded."""


@command.command("check", epilog="Example: vrbench rig check my-lab.yaml")
@click.argument("rig")
def check(rig: str) -> None:
    """Look at every device of RIG, without moving anything, and say what is wrong and what to do.

    Exit code 1 where something is wrong.
    """
    from vrbench.cli._rig_check import check_rig
    from vrbench.config.rig import load_rig
    from vrbench.plugin.manager import Plugins

    wrong = 0
    for found in check_rig(load_rig(rig), rig, Plugins()):
        wrong += not found.finding.ok
        click.echo(_line(found))
    if wrong:
        click.echo(f"{wrong} {'things are' if wrong > 1 else 'thing is'} wrong", err=True)
    sys.exit(1 if wrong else 0)


def _line(found: Checked) -> str:
    finding = found.finding
    text = f"{'ok   ' if finding.ok else 'WRONG'} {found.device}: {finding.what}"
    return text if finding.ok or not finding.fix else f"{text}\n      fix: {finding.fix}"
