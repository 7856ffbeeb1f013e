"""vrbench's processes as tests see them: started, found by the run they are at, and gone."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from vrbench.results.bundle import LOCK

TABLES = ("metrics/vrbench-1.csv", "metrics/vrbench-1.phase.csv", "metrics/vrbench-1.plots.json")


def start(*words: str | Path, cwd: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "vrbench", *map(str, words)],
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def until(true: Callable[[], object]) -> None:
    for _ in range(2400):
        if true():
            return
        time.sleep(0.05)
    pytest.fail("it never came")


def evaluator(run: Path) -> int:
    """Which process evaluates a run: waits until one does."""
    found: list[int] = []

    def there() -> bool:
        try:
            found.append(int((run / LOCK).read_text()))
        except (OSError, ValueError):
            return False
        return True

    until(there)
    return found[-1]


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return state(pid)[0] == "Z"


def state(pid: int) -> list[str]:
    """The fields of a process behind its name: state, parent, ..."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()


def tables(run: Path) -> list[bytes]:
    return [(run / name).read_bytes() for name in (*TABLES, "calibration.json")]
