"""The fenced blocks of READMEs and docs: found, told apart, and run.

The first word of a fence is its language, the words behind it say what it needs. A `console` block
without any is run. The others are checked, but not run unless `VRBENCH_DOCS` names their word:

    setup       installs something, or wants a clean checkout
    demo        `make demo` runs it; the Makefile must say the same
    hardware    wants devices, a person, or emulators that move in real time
    data        wants recordings, which VRBENCH_DATA names
    slow        takes minutes
    tutorial    is run, in a copy of the folder that docs/tutorial.md leaves behind
    exit=N      is run, and its last command must exit with N
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from markdown_it import MarkdownIt

REPO = Path(__file__).parents[2]
PAGES = [
    REPO / "README.md",
    *sorted((REPO / "docs").glob("*.md")),
    *sorted((REPO / "plugins").glob("*/*/README.md")),
    *sorted((REPO / "plugins").glob("*/*/*/README.md")),
]
NOT_RUN = frozenset({"setup", "demo", "hardware", "data", "slow"})
COLUMNS = "80"
# What only a shell understands.
SHELLS = re.compile(r"[|;&<>$`*?~\\]")
INSTALLS = re.compile(r"\b(pip|make|apt-get|npm) ")
MARKS = NOT_RUN | {"tutorial"}


@dataclass(frozen=True)
class Block:
    """A block of a page: its language, the words behind it, and its text."""

    page: Path
    line: int
    language: str
    marks: frozenset[str]
    text: str

    @property
    def place(self) -> str:
        return f"{self.page.relative_to(REPO)}:{self.line}"

    @property
    def skipped(self) -> bool:
        """Whether it is checked only."""
        return bool((self.marks & NOT_RUN) - set(os.environ.get("VRBENCH_DOCS", "").split(",")))

    @property
    def exit_code(self) -> int:
        return next((int(m.removeprefix("exit=")) for m in self.marks if m.startswith("exit=")), 0)


@dataclass(frozen=True)
class Command:
    """A command of a `console` block, and the lines that the page shows as its output."""

    text: str
    shown: tuple[str, ...]


def blocks(page: Path) -> list[Block]:
    """The blocks of a page, but for directives of Sphinx."""
    found = []
    for token in MarkdownIt("commonmark").parse(page.read_text(encoding="utf-8")):
        if token.type not in ("fence", "code_block") or token.info.startswith("{"):
            continue
        language, *marks = token.info.split() or ["indented" if token.type != "fence" else ""]
        line = (token.map or [0])[0] + 1
        found.append(Block(page, line, language, frozenset(marks), token.content))
    return found


def commands(block: Block) -> list[Command]:
    """Its commands: lines behind `$ `, with a here-document or what follows a backslash."""
    found: list[tuple[list[str], list[str]]] = []
    until: str | None = None
    for line in block.text.splitlines():
        if until is not None or (found and not found[-1][1] and found[-1][0][-1].endswith("\\")):
            found[-1][0].append(line)
            until = None if line == until else until
        elif line.startswith("$ "):
            found.append(([line[2:]], []))
            until = "END" if "<<'END'" in line else None
        else:
            assert found, f"{block.place}: output without a command"
            found[-1][1].append(line)
    return [Command("\n".join(text), tuple(shown)) for text, shown in found]


def run(block: Block, folder: Path) -> None:
    """Runs the block's commands; what the page shows of their output must be in it, in order."""
    every = commands(block)
    for command in every:
        assert not INSTALLS.search(command.text), f"{block.place}: say `console setup`"
        simple = command.text.startswith("vrbench ") and not SHELLS.search(command.text)
        code, printed = (_here if simple else _shell)(command.text, folder)
        wanted = block.exit_code if command is every[-1] else 0
        told = f"{block.place}: $ {command.text}\n{printed}"
        assert code == wanted, told
        rest: Iterator[str] = iter(" ".join(line.split()) for line in printed.splitlines())
        for line in command.shown:
            shown = " ".join(line.split())
            assert shown in ("", "...") or shown in rest, f"shown, not printed: {line}\n{told}"


def _here(command: str, folder: Path) -> tuple[int, str]:
    """Exit code and output of a `vrbench` without shell: in this process, which is quicker."""
    from vrbench.cli import main

    printed = io.StringIO()
    argv, columns = sys.argv, os.environ.get("COLUMNS")
    sys.argv, os.environ["COLUMNS"] = shlex.split(command, comments=True), COLUMNS
    try:
        with (
            contextlib.chdir(folder),
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(printed),
        ):
            main()
    except SystemExit as stop:
        return int(stop.code or 0), printed.getvalue()
    finally:
        sys.argv = argv
        del os.environ["COLUMNS"]
        os.environ |= {} if columns is None else {"COLUMNS": columns}
    return 0, printed.getvalue()


def _shell(command: str, folder: Path) -> tuple[int, str]:
    """Exit code and output of what bash makes of a command."""
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "COLUMNS": COLUMNS,
    }
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", command],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=600,
        check=False,
    )
    return done.returncode, done.stdout
