"""Peers and vrbench on the same files, in turn: tables in Markdown, with versions.

    make bench        python -m benchmarks [NAME ...] [--quick] [--rounds 3] [--folder DIR]

Peers are the extra `bench`; those that aren't installed are left out, by name. Files that are made
up stay in the folder, 2 GB of them, for the next time.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from pathlib import Path

from benchmarks.measure import FailedError, installed
from benchmarks.sections import SECTIONS, TITLES, Extent

PACKAGES = (
    *("vrbench", "numpy", "scipy", "evo", "mcap", "mcap-ros2-support", "foxglove-sdk", "rosbags"),
    *("opencv-python-headless", "eaik", "ur-analytic-ik"),
)


def versions() -> str:
    """The machine and what is installed on it, in a line."""
    found = [f"{name} {installed(name)}" for name in PACKAGES if installed(name)]
    python = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    return f"{python}, {os.cpu_count()} cores; " + ", ".join(found) + "."


def main() -> None:
    """Prints the sections asked for, or all."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(SECTIONS))
    parser.add_argument("--quick", action="store_true", help="small sizes only, one round")
    parser.add_argument("--rounds", type=int, default=3, help="how often each contestant runs")
    parser.add_argument("--folder", type=Path, default=Path("build/bench"))
    asked = parser.parse_args()
    unknown = sorted(set(asked.names) - set(SECTIONS))
    if unknown:
        parser.error(f"no benchmark {', '.join(unknown)}: there are {', '.join(SECTIONS)}")
    folder = asked.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    extent = Extent(folder, 1 if asked.quick else asked.rounds, asked.quick)
    # one thread each, as vrbench's own workers have: CPU time is then work, not waiting
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    print(versions())
    failed = False
    for name in asked.names or SECTIONS:
        print(f"\n## {TITLES[name]}\n\n`python -m benchmarks {name}`", flush=True)
        print(f"{name}:", file=sys.stderr, flush=True)
        try:
            for text in SECTIONS[name](extent):
                print(f"\n{text}", flush=True)
        except FailedError as error:
            failed = True
            print(f"\nFailed: {error}", flush=True)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
