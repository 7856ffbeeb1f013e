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
