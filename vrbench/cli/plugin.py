"""`vrbench plugin`: what is installed."""

from __future__ import annotations

import click


@click.group()
def command() -> None:
    """Plugins: list what is installed, and what is broken."""


@command.command("list")
def list_() -> None:
    """List plugins with their versions, and all that they offer."""
    from vrbench.cli._tables import show_table
    from vrbench.plugin.manager import Plugins, titles

    plugins = Plugins()
    rows = [
        [
            info.name,
            info.distribution,
            info.version,
            f"broken: {info.broken}" if info.broken else "ok",
        ]
        for info in plugins.infos
    ]
    show_table("Plugins", ["name", "distribution", "version", "status"], rows)
    offers = [
        [kind, name, title]
        for kind, things in (
            ("headset", plugins.headsets),
            ("mocap", plugins.mocap),
            ("robot", plugins.robots),
            ("importer", plugins.importers),
            ("metric", plugins.metrics),
        )
        for name, title in titles(things)
    ]
    offers += [["suite", name, str(path.name)] for name, path in plugins.suites.items()]
    show_table("What they offer", ["kind", "name", "title"], offers)
