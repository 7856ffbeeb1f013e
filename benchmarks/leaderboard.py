"""How fast a board of a thousand runs is: `python -m benchmarks.leaderboard`, from the checkout.

Makes bundles with tables as long as those of a true run of gameplay-replay (some 450 kB of metrics
and 360 kB of errors by phase each), and times `vrbench leaderboard` on them in its own process.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.results.made_up import made_up

# What fills a table up to the length of a true one.
FILLER = 640
DEVICES = 20


def make(folder: Path, count: int) -> list[Path]:
    """So many bundles: 20 devices of one lab, and those of other labs, who measured the same."""
    rng = np.random.default_rng(0)
    made = [folder / f"run-{i:04}" for i in range(count)]
    for i, run in enumerate(made):
        if i < DEVICES:
            made_up(
                run,
                rng=rng,
                device=f"headset-{i}",
                error=1.5 + 0.1 * i,
                filler=FILLER,
                all_phases=True,
            )
            continue
        shutil.copytree(made[i % DEVICES], run)
        record = json.loads((run / "run.json").read_text())
        record["lab"] = f"lab-{1 + i // DEVICES}"
        for take in record["takes"]:
            take["sha256"] = f"{i:06}{take['sha256'][6:]}"
        (run / "run.json").write_text(json.dumps(record))
    return made


def main() -> None:
    """Prints wall and CPU seconds, and the peak of memory."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--count", type=int, default=1000)
    options.add_argument("--folder", type=Path, help="keep the bundles here, or take those there")
    chosen = options.parse_args()
    with TemporaryDirectory() as temporary:
        folder = chosen.folder or Path(temporary)
        runs = sorted(folder.glob("run-*")) or make(folder, chosen.count)
        size = sum(path.stat().st_size for run in runs for path in run.rglob("*") if path.is_file())
        code = "from vrbench.cli import main; main()"
        began = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-c", code, "leaderboard", *map(str, runs)],
            check=True,
            capture_output=True,
            env={**os.environ, "COLUMNS": "80"},
        )
        wall = time.perf_counter() - began
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        lines = len(done.stdout.splitlines())
        print(f"{len(runs)} runs, {size / 1e6:.0f} MB; {lines} lines")
        print(f"wall {wall:.2f} s, CPU {used.ru_utime + used.ru_stime:.2f} s")
        print(f"peak {used.ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
