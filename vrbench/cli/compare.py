"""`vrbench compare`: two runs, paired by phase of the motion."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(epilog="Example: vrbench compare runs/quest-2 runs/quest-pro")
@click.argument("first", metavar="A", type=click.Path(path_type=Path))
@click.argument("second", metavar="B", type=click.Path(path_type=Path))
@click.option("--protocol", default="vrbench-1", show_default=True, help="How takes were scored.")
def command(first: Path, second: Path, protocol: str) -> None:
    """Say by how much run A errs more than run B, and whether the two can be told apart.

    By condition; paired by the motion's phase, so that what is hard for both cancels.
    """
    from vrbench.cli._boards import show_comparisons
    from vrbench.protocols.registry import find_protocol
    from vrbench.results.bundle import Bundle
    from vrbench.results.comparison import compare

    find_protocol(protocol)
    show_comparisons(first, second, compare(Bundle.open(first), Bundle.open(second), protocol))
