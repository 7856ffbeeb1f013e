"""`vrbench schema`: what files may hold, as JSON Schema."""

from __future__ import annotations

import json

import click


@click.command(epilog="Example: vrbench schema suite > suite.schema.json")
@click.argument("name", type=click.Choice(["suite", "rig", "recordings", "results"]))
def command(name: str) -> None:
    """Print the JSON Schema of a suite, a rig, a recordings file, or a run's `run.json`."""
    from vrbench.results.schemas import json_schema

    click.echo(json.dumps(json_schema(name), indent=1))
