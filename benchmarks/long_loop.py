"""Two hours in virtual time: what recording and evaluating `long-loop` take, and what they find.

    python benchmarks/long_loop.py [-o FOLDER] [--mocap]

The clock of the simulated headset gains 25 ppm, and 10 ppm more and less; nothing else drifts.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from vrbench.config.rig import load_rig
from vrbench.config.suite import load_suite
from vrbench.plugin.manager import Plugins
from vrbench.results.tables import read_rows
from vrbench.runner import record_suite

RIG = """
lab: simulated
headset: {plugin: sim, device: quest-2, options: {clock_skew_ppm: 25.0, clock_wander_ppm: 10.0}}
robot: {plugin: sim, accuracy: {value: 0.03 mm, source: simulated}}
"""
MOCAP = "mocap: {plugin: sim}\n"


class Quiet:
    """A watcher that nothing is told to."""

    def take(self, name: str, index: int, total: int) -> None:
        pass

    def moving(self, progress: Any) -> None:
        pass

    def notice(self, text: str) -> None:
        pass


def tell(what: str, who: int) -> None:
    """Prints CPU time and the largest memory of this process, or of its children."""
    used = resource.getrusage(who)
    seconds, peak = used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3
    print(f"{what}: {seconds:.1f} s of CPU, {peak:.0f} MB at most", flush=True)


def main() -> None:
    """Records, evaluates, and prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--mocap", action="store_true", help="a second reference, at 240 Hz")
    asked = parser.parse_args()
    folder = asked.output or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    rig = folder / "rig.yaml"
    rig.write_text(RIG + (MOCAP if asked.mocap else ""))
    suite, run = load_suite("long-loop"), folder / "run"
    record_suite(suite, load_rig(str(rig)), str(rig), run, Plugins(), seed=1, watcher=Quiet())
    tell("record", resource.RUSAGE_SELF)
    words = ("evaluate", "--no-cache", str(run))
    subprocess.run([sys.executable, "-m", "vrbench", *words], check=True, capture_output=True)
    tell("vrbench evaluate", resource.RUSAGE_CHILDREN)
    rows = read_rows(run / "metrics" / "vrbench-1.csv")
    shown = {"ape.translation.aligned", "drift.translation", "clock.offset"}
    statistics = {"rmse", "slope", "last-first", "value"}
    for row in rows:
        mine = row.case == "loop" and row.variant == "main" and row.band == "all"
        if mine and row.metric in shown and row.statistic in statistics and row.point != "tcp":
            ends = "" if row.ci_low is None else f" [{row.ci_low:.3f}, {row.ci_high:.3f}]"
            print(f"{row.segment:8} {row.metric:24} {row.statistic:10} {row.value:.3f}{ends}")
    if asked.output is None:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
