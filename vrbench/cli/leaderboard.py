"""`vrbench leaderboard`: runs side by side."""

from __future__ import annotations

import sys
from pathlib import Path

import click


@click.command(epilog="Example: vrbench leaderboard runs/*")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--protocol", default="vrbench-1", show_default=True, help="How takes were scored.")
@click.option(
    "--format",
    "form",
    type=click.Choice(["table", "csv", "md", "latex", "json"]),
    default="table",
    show_default=True,
    help="What to print.",
)
@click.option("-o", "output", type=click.Path(path_type=Path), help="Write to this file instead.")
def command(runs: tuple[Path, ...], protocol: str, form: str, output: Path | None) -> None:
    """Show the devices of RUNS side by side, on one board for each thing they must share.

    Devices that can't be told apart share a rank: `1-2` may be the first or the second. A run that
    can't be read is left out and told, and the exit code is 1.
    """
    from vrbench.cli._boards import show_boards
    from vrbench.results.bundle import replace_text
    from vrbench.results.leaderboard import leaderboard

    found = leaderboard(runs, protocol)
    if not found.boards:
        raise found.left_out[0].error
    if form == "table":
        show_boards(found.boards)
    else:
        from vrbench.results.board_formats import FORMATS

        text = FORMATS[form](found)
        if output is None:
            click.echo(text, nl=False)
        else:
            replace_text(output, text)
    for left_out in found.left_out:
        click.echo(f"left out: {left_out.error}", err=True)
    sys.exit(1 if found.left_out else 0)
