"""`vrbench export`: a run's takes in the files of other tools."""

from __future__ import annotations

from pathlib import Path

import click

from vrbench.results.export import FORMATS


@click.command(
    epilog="Examples: vrbench export my-run --format evo -o zips && evo_res zips/*.zip; "
    "vrbench export my-run --format tum -o tum"
)
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--format", "form", type=click.Choice(FORMATS), required=True, help="Which files.")
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="A new folder for them."
)
@click.option(
    "--protocol", default="vrbench-1", show_default=True, help="How takes are made ready."
)
def command(run: Path, form: str, output: Path, protocol: str) -> None:
    """Write the takes of RUN, synchronised as they are scored, for other tools.

    tum: truth and estimate of each take, which evo_ape and evo_traj read. evo: result zips for
    evo_res. csv, parquet: every sample with its errors. foxglove: a layout for Foxglove and
    Lichtblick, which open the takes themselves.
    """
    from vrbench.cli._tables import bar
    from vrbench.exporting import export
    from vrbench.protocols.registry import find_protocol
    from vrbench.results.bundle import Bundle

    chosen = find_protocol(protocol)
    left_out: list[str] = []
    with bar(f"export {run.name}") as tell:
        written = export(
            Bundle.open(run),
            form,
            chosen,
            output,
            lambda name, i, total: tell(name, i / total),
            left_out.append,
        )
    for reason in left_out:
        click.echo(f"left out: {reason}", err=True)
    click.echo(f"{len(written)} files: {output}")
