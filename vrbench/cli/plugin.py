"""`vrbench plugin`: what is installed, and the kit for writing more."""

from __future__ import annotations

from pathlib import Path

import click


@click.group()
def command() -> None:
    """Plugins: list what is installed and what is broken; make a new one, and check it."""


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


@command.command(
    "emulate",
    context_settings={"ignore_unknown_options": True},
    epilog="Example: vrbench plugin emulate optitrack -- --version 3.1 --multicast",
)
@click.argument("device")
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def emulate(device: str, arguments: tuple[str, ...]) -> None:
    """Run the emulator of DEVICE on this computer; `-- --help` lists its own ARGUMENTS."""
    import signal
    import subprocess
    import sys

    from vrbench.errors import ConfigError
    from vrbench.plugin.manager import Plugins

    plugins = Plugins()
    modules = {
        spec.name: spec.emulator
        for specs in (plugins.headsets, plugins.mocap, plugins.robots)
        for spec in specs.values()
        if spec.emulator is not None
    }
    if device not in modules:
        raise ConfigError(
            f"no emulator of {device!r}", fix=f"there are {', '.join(sorted(modules)) or 'none'}"
        )
    running = subprocess.Popen([sys.executable, "-m", modules[device], *arguments])
    # who ends this process ends the emulator too
    signal.signal(signal.SIGTERM, lambda *_: running.terminate())
    try:
        sys.exit(running.wait())
    except KeyboardInterrupt:
        running.terminate()
        sys.exit(running.wait())


@command.command("new", epilog="Example: vrbench plugin new headset pico4")
@click.argument(
    "kind", type=click.Choice(["headset", "mocap", "robot", "importer", "metric", "suite"])
)
@click.argument("name")
@click.option(
    "-o",
    "parent",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path(),
    help="Folder to make it in; the working directory.",
)
def new(kind: str, name: str, parent: Path) -> None:
    """Make a plugin that offers a KIND called NAME: it installs, and passes its tests, at once."""
    from vrbench.plugin.scaffold import scaffold, steps

    folder = scaffold(kind, name, parent)
    click.echo(f"{folder} is a plugin; its README says what to edit. To a row on a leaderboard:\n")
    for step in steps(folder, name):
        click.echo(f"  {step}")
    click.echo(f"\nvrbench plugin check {name} tells what is still wrong with it.")


@command.command("check", epilog="Example: vrbench plugin check pico4 -o report.json")
@click.argument("name")
@click.option(
    "--recordings",
    help="A recordings file with logs of its format, or the name of a shipped one.",
)
@click.option(
    "-o",
    "output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Keep the report here too.",
)
def check(name: str, recordings: str | None, output: Path | None) -> None:
    """Check what the plugin NAME offers, or the one device, format, metric or suite NAME.

    A device is played by its stand-in, for a few seconds; nothing real moves. The newest report of
    each thing is kept, and runs copy those of their devices into their bundle.
    """
    import os
    import sys

    from vrbench.cli._conformance import show_report
    from vrbench.plugin import report
    from vrbench.plugin.manager import Plugins
    from vrbench.plugin.testing import patience

    plugins = Plugins()
    reports = []
    for kind, thing in report.found(name, plugins):
        reports.append(report.check(kind, thing, plugins, recordings))
        show_report(reports[-1])
        report.keep(reports[-1])
    if output is not None:
        output.write_text(report.as_text(reports), encoding="utf-8")
    if patience.hanging():  # nobody waits for the threads of a device that hangs
        sys.stdout.flush()
        os._exit(1)
    sys.exit(0 if all(each.passed for each in reports) else 1)
