"""`vrbench record`: record a suite on a rig, without evaluating it."""

from __future__ import annotations

import click

from vrbench.cli._recording import Asked, record, recording


@click.command(epilog="Example: vrbench record calibration --rig sim -o my-run")
@recording
def command(asked: Asked) -> None:
    """Record SUITE on a rig; `vrbench evaluate` scores it later."""
    from vrbench.cli._steps import show_runs

    show_runs([record(asked)])
