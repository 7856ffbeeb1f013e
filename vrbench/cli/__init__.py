"""The command line: one file a verb; a verb's file is imported when the verb is needed."""

from __future__ import annotations

import importlib
import os
import pkgutil
import sys

import click

from vrbench import __version__
from vrbench.batch.threads import use_one_thread
from vrbench.errors import VrbenchError

# Set to anything, errors of vrbench itself end in a traceback.
TRACEBACK = "VRBENCH_TRACEBACK"


class _Verbs(click.Group):
    """Finds each verb in the file that bears its name."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        names = (info.name for info in pkgutil.iter_modules(__path__))
        return sorted(name.rstrip("_") for name in names if not name.startswith("_"))

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in self.list_commands(ctx):
            return None
        # `import` is a keyword, so its file is `import_`
        module = f"{name}_" if name == "import" else name
        command: click.Command = importlib.import_module(f"{__name__}.{module}").command
        return command


@click.group(
    cls=_Verbs,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Try it: vrbench run gameplay-replay --rig sim:quest-2",
)
@click.version_option(__version__, prog_name="vrbench")
def cli() -> None:
    """Measures how accurately a VR headset knows where it is.

    A suite says what to do and what to report, a rig names the devices. `run` records takes and
    evaluates them; `import` makes takes of recordings that exist; `leaderboard` compares runs.

    Exit codes: 0 ok, 1 a result is invalid or failed, 2 usage or configuration.
    """


def main() -> None:
    """The `vrbench` command: no traceback reaches a user."""
    use_one_thread()
    try:
        cli(standalone_mode=False)
    except click.exceptions.Abort:
        click.echo("interrupted", err=True)
        sys.exit(1)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except VrbenchError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        click.echo("interrupted", err=True)
        sys.exit(1)
    except BrokenPipeError:
        # what reads our output has seen enough
        sys.stderr.close()
        sys.exit(0)
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        click.echo(f"error: {place}{error.strerror or error}", err=True)
        sys.exit(1)
    except Exception as error:
        if os.environ.get(TRACEBACK):
            raise
        told = f"{type(error).__name__}: {error}".encode(errors="backslashreplace").decode()
        click.echo(f"error: vrbench itself failed: {told}", err=True)
        click.echo(f"Please report it, with what {TRACEBACK}=1 prints.", err=True)
        sys.exit(1)
