"""`vrbench data`: published recordings."""

from __future__ import annotations

import sys

import click


@click.group()
def command() -> None:
    """Published recordings: which are there, which files are missing, and to fetch them."""


@command.command("list")
def list_() -> None:
    """List the files of known datasets and of the shipped recordings that use them.

    Files are looked for below the folder that VRBENCH_DATA names, or in the cache that `fetch`
    fills, and their sha256 is checked.
    """
    from vrbench.cli._tables import show_table
    from vrbench.config.recordings import load_recordings
    from vrbench.config.shipped import shipped_files
    from vrbench.recording import datasets

    altered = False
    states: dict[str, dict[str, str]] = {}
    for dataset in datasets.DATASETS.values():
        files = datasets.status(dataset.name)
        states[dataset.name] = {file.path: file.state.value for file in files}
        altered |= "altered" in states[dataset.name].values()
        show_table(
            f"{dataset.name}: {dataset.title}\n{dataset.licence}, doi {dataset.doi}",
            ["file", "state"],
            list(states[dataset.name].items()),
        )
        if set(states[dataset.name].values()) != {"present"}:
            click.echo(f"To have all of it: {dataset.how_to_get}.")
    rows = []
    for name, path in shipped_files("recordings").items():
        recordings = load_recordings(path)
        sources = [source for take in recordings.takes for source in take.sources.values()]
        wanted = {source.path.as_posix() for source in sources}
        there = states.get(recordings.dataset or "", {})
        lacking = sorted(file for file in wanted if there.get(file) != "present")
        rows.append([name, "ready" if not lacking else "lacks " + ", ".join(lacking)])
    show_table("Shipped recordings, for `vrbench import NAME`", ["name", "state"], rows)
    sys.exit(1 if altered else 0)


@command.command("fetch", epilog="Example: vrbench data fetch banaszczyk2024")
@click.argument("name")
def fetch(name: str) -> None:
    """Fetch what is missing of the dataset NAME from where it is published, by sha256.

    It goes below the folder that VRBENCH_DATA names, or to your cache. A download that broke off
    goes on from there.
    """
    from vrbench.recording import datasets
    from vrbench.recording.fetching import fetch as fetch_files

    dataset = datasets.known(name)
    click.echo(f"{dataset.title}\n{dataset.licence}, {dataset.upstream}, commit {dataset.commit}")
    folder = fetch_files(name, lambda path, what: click.echo(f"  {path}: {what}"))
    click.echo(f"It is in {folder}.")
