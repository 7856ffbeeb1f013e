"""`vrbench import`: recordings that exist already -> a run."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("import", epilog="Example: vrbench import banaszczyk2024-quest-2 -o quest-2")
@click.argument("recordings")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="The new run's folder [runs/...]."
)
def command(recordings: str, output: Path | None) -> None:
    """Make a run of the takes that RECORDINGS lists: a .yaml file, or a shipped one's name."""
    from vrbench.cli._steps import show_runs
    from vrbench.cli._tables import bar
    from vrbench.importing import import_recordings
    from vrbench.plugin.manager import Plugins

    with bar(f"import {recordings}") as tell:
        bundle = import_recordings(
            recordings, output, Plugins(), lambda name, i, total: tell(name, i / total)
        )
    for take in bundle.record.takes:
        for repair in take.repairs:
            click.echo(f"repaired: {take.name}: {repair}", err=True)
    click.echo(f"{len(bundle.record.takes)} takes of {bundle.record.device.headset}")
    show_runs([bundle])
