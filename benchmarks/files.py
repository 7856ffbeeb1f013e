"""The files that benchmarks run on: where they are; a process of its own makes what isn't there.

A process shows at least as much memory as the one that started it held, so this one stays small:
neither numpy nor vrbench is imported here.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.measure import run, work


def tum_files(folder: Path, seconds: int) -> tuple[str, str]:
    """TUM text of a reference at 120 Hz and of a headset at 72 Hz."""
    found = tuple(folder / f"{name}-{seconds}.tum" for name in ("reference", "headset"))
    if not all(path.exists() for path in found):
        run(work("make-tum", seconds, *found))
    return str(found[0]), str(found[1])


def take_file(folder: Path, seconds: int, *, joints: bool = True) -> str:
    """A take: a robot's poses at 120 Hz, a headset's at 72 Hz, joints at 500 Hz."""
    path = folder / f"take-{seconds}{'' if joints else '-poses'}.mcap"
    if not path.exists():
        run(work("make-take", seconds, path, "joints" if joints else "poses"))
    return str(path)
