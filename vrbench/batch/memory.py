"""Whether there is memory for an evaluation: asked before it begins.

A take is evaluated whole: clock and mounting are fitted to all of it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from vrbench.errors import ConfigError, DataError, VrbenchError
from vrbench.recording.summary import poses_in
from vrbench.results.bundle import Bundle
from vrbench.results.files import inside

# Of each pose that a take holds; measured: see docs/many.md. The largest take is worked on while
# what is left of the others is kept.
BASE_BYTES = 200e6
OF_LARGEST, OF_OTHERS = 720.0, 360.0


def needed_bytes(bundle: Bundle) -> float:
    """How much memory the evaluation of a run takes, about."""
    paths = [inside(bundle.folder, take.file) for take in bundle.record.takes]
    poses = sorted(poses_in(path) for path in paths if path.is_file())
    largest = poses[-1] if poses else 0
    return BASE_BYTES + OF_LARGEST * largest + OF_OTHERS * sum(poses[:-1])


def available_bytes() -> float | None:
    """How much memory this process may still take; None where the system doesn't say.

    On Linux the least of what the system has, its control group may have, and `ulimit -v` leaves.
    """
    found = []
    with suppress(OSError, ValueError, IndexError):
        fields = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        found.append(float(fields["MemAvailable"].split()[0]) * 1024)
    with suppress(OSError, ValueError):
        group = Path("/sys/fs/cgroup")
        limit = float((group / "memory.max").read_text())  # "max" is no number
        lines = (group / "memory.stat").read_text().splitlines()
        cached = next(float(line.split()[1]) for line in lines if line.startswith("inactive_file"))
        found.append(limit - float((group / "memory.current").read_text()) + cached)
    if sys.platform == "linux":
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            found.append(float(limit - pages * resource.getpagesize()))
    return min(found, default=None)


def _told(size: float) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e10 else f"{size / 1e6:.0f} MB"


def check_memory(bundle: Bundle) -> None:
    """Refuses a run that memory has no room for.

    Raises:
        DataError: with what it would take, and what there is.
    """
    need, free = needed_bytes(bundle), available_bytes()
    if free is not None and need > free:
        raise DataError(
            f"its evaluation takes about {_told(need)} of memory, {_told(free)} are free",
            file=bundle.folder,
            fix="free some, or evaluate it on a larger computer",
        )


def check_memory_of_all(runs: Sequence[str], jobs: int) -> None:
    """Refuses more runs at a time than memory has room for; those too large by themselves apart.

    Runs that can't be opened are told when it is their turn.

    Raises:
        ConfigError: with how many there is room for.
    """
    free = available_bytes()
    if free is None:
        return
    needs = []
    for run in runs:
        with suppress(VrbenchError, OSError):
            needs.append(needed_bytes(Bundle.open(Path(run))))
    needs = sorted((need for need in needs if need <= free), reverse=True)
    if sum(needs[:jobs]) > free:
        fitting = next(n for n in range(jobs, 0, -1) if sum(needs[:n]) <= free)
        raise ConfigError(
            f"{jobs} of these runs at a time take about {_told(sum(needs[:jobs]))} of memory, "
            f"{_told(free)} are free",
            field="--jobs",
            fix=f"{fitting} at most",
        )
