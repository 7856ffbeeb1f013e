"""Two hours in virtual time: what recording and evaluating `long-loop` take, and what they find.

    python benchmarks/long_loop.py [-o FOLDER] [--mocap]

The clock of the simulated headset gains 25 ppm, and 10 ppm more and less; nothing else drifts.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

from vrbench.config.rig import load_rig
from vrbench.config.suite import load_suite
from vrbench.evaluation import evaluate
from vrbench.plugin.manager import Plugins, families_of
from vrbench.protocols.vrbench_1 import PROTOCOL
from vrbench.results.bundle import Bundle
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


def told(what: str, since: float) -> float:
    """Prints CPU time and the largest memory so far; the time now."""
    now = time.process_time()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(f"{what}: {now - since:.1f} s of CPU, {peak:.0f} MB at most", flush=True)
    return now


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
    plugins, suite = Plugins(), load_suite("long-loop")
    began = time.process_time()
    run = folder / "run"
    record_suite(suite, load_rig(str(rig)), str(rig), run, plugins, seed=1, watcher=Quiet())
    began = told("record", began)
    families = families_of(suite, plugins, None)
    rows = evaluate(Bundle.open(run), families, PROTOCOL, lambda *_: None)
    told("evaluate", began)
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
