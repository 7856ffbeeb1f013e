"""Measuring: work in processes of their own, in turn, by what the system says they used.

Processors are shared and change their speed; so contestants take turns within one run, and their
ratio is taken round by round. CPU time counts, not the clock on the wall.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EXTRA = "python -m pip install --constraint constraints.txt --editable '.[bench]'"


@dataclass(frozen=True, slots=True)
class Used:
    """What a process used.

    Attributes:
        cpu_s: CPU time, of all its threads, by user and system [s]; of the work alone where the
            process told it.
        peak_mb: the most memory it held at once [MB].
        told: what its last line said, if that was JSON.
    """

    cpu_s: float
    peak_mb: float
    told: Mapping[str, float]


class FailedError(RuntimeError):
    """A contestant that didn't do its work."""


def run(command: Sequence[str], *, environment: Mapping[str, str] | None = None) -> Used:
    """Runs a command to its end.

    Raises:
        FailedError: it ended with an error.
    """
    with tempfile.TemporaryFile() as said, tempfile.TemporaryFile() as wrong:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=said, stderr=wrong, cwd=ROOT,
            env={**os.environ, **(environment or {})},
        )  # fmt: skip
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0), wrong.seek(0)
        lines = said.read().decode(errors="replace").strip().splitlines()
        if process.returncode:
            last = wrong.read().decode(errors="replace").strip().splitlines() or lines or ["?"]
            raise FailedError(f"exit code {process.returncode}: {last[-1]}")
    told = {}
    if lines and lines[-1].startswith("{"):
        told = json.loads(lines[-1])
    cpu = told.get("cpu_s", usage.ru_utime + usage.ru_stime)
    unit = 1 if sys.platform == "darwin" else 1024
    return Used(cpu, usage.ru_maxrss * unit / 1e6, told)


def work(name: str, *words: object) -> list[str]:
    """The command that runs a piece of work of `benchmarks.work`, which tells its own CPU time."""
    return [sys.executable, "-m", "benchmarks.work", name, *map(str, words)]


def program(name: str) -> str:
    """A program installed beside this Python."""
    return str(Path(sys.executable).with_name(name))


@dataclass(frozen=True, slots=True)
class Measured:
    """A contestant over all rounds: medians.

    Attributes:
        cpu_s: CPU time [s].
        peak_mb: the most memory at once [MB].
        ratio: of its CPU time to the first contestant's, round by round.
        told: what it said of itself in the last round.
    """

    cpu_s: float
    peak_mb: float
    ratio: float
    told: Mapping[str, float]


def in_turn(contestants: Mapping[str, Sequence[str]], rounds: int) -> dict[str, Measured]:
    """Runs all of them, round by round, the first being what the others are compared with."""
    found: dict[str, list[Used]] = {name: [] for name in contestants}
    for number in range(rounds):
        for name, command in contestants.items():
            print(f"  {name} ({number + 1} of {rounds})", file=sys.stderr, flush=True)
            found[name].append(run(command))
    first = next(iter(found.values()))
    median = statistics.median
    return {
        name: Measured(
            median(one.cpu_s for one in used),
            median(one.peak_mb for one in used),
            median(one.cpu_s / base.cpu_s for one, base in zip(used, first, strict=True)),
            used[-1].told,
        )
        for name, used in found.items()
    }


def installed(distribution: str) -> str | None:
    """The version of a package, None where it isn't installed."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return None


def missing(*distributions: str) -> list[str]:
    """What isn't installed of them, in words: left out, and how to have it."""
    gone = [name for name in distributions if installed(name) is None]
    return [f"Left out: {name} is not installed: `{EXTRA}`." for name in gone]


def free_mb() -> float:
    """Memory that is free now [MB]; without end where the system doesn't say."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return float("inf")
    return next(int(line.split()[1]) / 1e3 for line in lines if line.startswith("MemAvailable"))


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """By which power costs grow with sizes: the slope of their logarithms."""
    from math import log

    x, y = [log(size) for size in sizes], [log(cost) for cost in costs]
    mean_x, mean_y = statistics.fmean(x), statistics.fmean(y)
    along = sum((a - mean_x) ** 2 for a in x)
    return sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y, strict=True)) / along


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown: names left, numbers right."""
    rule = ["---", *["---:"] * (len(header) - 1)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (header, rule, *rows))


def seconds(value: float) -> str:
    """CPU time with three digits [s]."""
    return f"{value:.3g}"


def times(ratio: float) -> str:
    """How many times as much."""
    return f"{ratio:.2f} x" if ratio < 10 else f"{ratio:.0f} x"
