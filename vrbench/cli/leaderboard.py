"""`vrbench leaderboard`: runs side by side."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from vrbench.results.board import Leaderboard


@click.command(
    epilog="Examples: vrbench leaderboard runs/*; vrbench leaderboard runs/* --format html -o site"
)
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--protocol", default="vrbench-1", show_default=True, help="How takes were scored.")
@click.option(
    "--format",
    "form",
    type=click.Choice(["table", "csv", "md", "latex", "json", "html"]),
    default="table",
    show_default=True,
    help="What to print; html is a site, a folder of pages.",
)
@click.option(
    "-o",
    "output",
    type=click.Path(path_type=Path),
    help="Write to this file instead; html: to this new folder.",
)
def command(runs: tuple[Path, ...], protocol: str, form: str, output: Path | None) -> None:
    """Show the devices of RUNS side by side, on one board for each thing they must share.

    Devices that can't be told apart share a rank: `1-2` may be the first or the second. A run that
    can't be read is left out and told, and the exit code is 1.
    """
    from vrbench.cli._boards import show_boards
    from vrbench.results.board_formats import FORMATS, one_line
    from vrbench.results.leaderboard import leaderboard
    from vrbench.text_file import replace_text

    found = leaderboard(runs, protocol)
    if not found.boards:
        from vrbench.protocols.registry import find_protocol

        find_protocol(protocol)
        raise found.left_out[0].error
    if form == "table":
        if output is not None:
            raise click.UsageError("-o needs a --format: csv, md, latex, json or html")
        show_boards(found.boards)
    elif form == "html":
        if output is None:
            raise click.UsageError("--format html needs -o, a new folder for the site")
        _write_site(found, runs, protocol, output)
    else:
        text = FORMATS[form](found)
        if output is None:
            click.echo(text, nl=False)
        else:
            replace_text(output, text)
    for left_out in found.left_out:
        click.echo(one_line(f"left out: {left_out.error}"), err=True)
    sys.exit(1 if found.left_out else 0)


def _write_site(found: Leaderboard, runs: Sequence[Path], protocol: str, output: Path) -> None:
    from vrbench.cli._tables import bar
    from vrbench.results.report.site import HOME, write_site

    with bar("site") as tell:
        write_site(found, runs, protocol, output, lambda name, i, total: tell(name, i / total))
    click.echo(f"site: {output / HOME}")
