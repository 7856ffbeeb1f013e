"""`vrbench leaderboard`: runs side by side."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(epilog="Example: vrbench leaderboard runs/*")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--protocol", default="vrbench-1", show_default=True, help="How takes were scored.")
def command(runs: tuple[Path, ...], protocol: str) -> None:
    """Show the devices of RUNS side by side, on one board for each thing they must share."""
    from vrbench.cli._tables import show_boards
    from vrbench.results.bundle import Bundle
    from vrbench.results.leaderboard import leaderboard

    show_boards(leaderboard([Bundle.open(folder) for folder in runs], protocol))
