"""Kills runs at random moments, and goes on with them: what is readable, and whether they finish.

    python benchmarks/kill_resume.py [--kills 100] [--seed 1]

Each run records a short suite on a simulated rig in a process of its own, which is killed (-9)
after a random time, again and again until it finishes. After every kill all complete chunks of
the take that was cut must read back, by vrbench and by mcap's own reader; at the end every take
must be, byte for byte, what a run gives that nothing happened to.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import random
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader

from vrbench.errors import DataError
from vrbench.recording.take import read_take

SUITE = """
suite: killed
version: 1
title: Eight short takes in two mounts
motions: {head: saturate-30s-1, calibration: saturate-30s-1}
cases:
  - {id: calibrate, motion: calibration, role: calibration}
  - {id: replay, motion: head, repeats: 2, remounts: 1, needs: [x, clock, y], anchor: 5 s}
metrics: [ape]
rank: {metric: ape.translation.aligned, point: eye, statistic: rmse, min_coverage: 95 %}
"""


def messages(path: Path) -> int:
    """How many messages mcap's own reader finds, up to where the file was cut."""
    count = 0
    with path.open("rb") as file, contextlib.suppress(EndOfFile, struct.error):
        for _ in NonSeekingReader(file).iter_messages(log_time_order=False):
            count += 1
    return count


def main() -> None:
    """Kills, reads back, goes on; prints the figures."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    rng = random.Random(given.seed)
    told = {"kills": 0, "runs": 0, "finished": 0, "cut takes read": 0, "messages in them": 0}
    told |= {"before the run began": 0, "takes unlike those of a whole run": 0}
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "suite.yaml").write_text(SUITE, encoding="utf-8")
        base = [sys.executable, "-m", "vrbench", "record", str(folder / "suite.yaml")]
        base += ["--rig", "sim:quest-2", "-o"]
        begun = time.monotonic()
        subprocess.run([*base, str(folder / "whole")], check=True, capture_output=True)
        span = time.monotonic() - begun
        while told["kills"] < given.kills:
            told["runs"] += 1
            run = folder / f"run-{told['runs']}"
            while not killed_or_done(base, run, rng.uniform(0.0, span), told):
                pass
            told["finished"] += 1
            for take in (folder / "whole" / "takes").iterdir():
                same = (run / "takes" / take.name).read_bytes() == take.read_bytes()
                told["takes unlike those of a whole run"] += not same
            print(json.dumps(told), flush=True)


def killed_or_done(base: list[str], run: Path, after_s: float, told: dict[str, int]) -> bool:
    """Begins a run, or goes on with it; whether it finished before it was killed."""
    more = ["--resume"] if (run / "run.json").is_file() else []
    process = subprocess.Popen(
        [*base, str(run), *more], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    try:
        _, said = process.communicate(timeout=after_s)
        if process.returncode:
            raise SystemExit(f"{run}: {said}")
        return True
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
    told["kills"] += 1
    told["before the run began"] += not (run / "run.json").is_file()
    for part in (run / "takes").glob("*.part"):
        count = messages(part)
        try:
            columns = read_take(part)
        except DataError as error:
            if count:
                raise SystemExit(f"{part}: {error}") from None
            continue
        told["cut takes read"] += 1
        told["messages in them"] += count
        found = sum(map(len, columns.poses.values())) + sum(map(len, columns.clocks.values()))
        if count and not found and not columns.events:
            raise SystemExit(f"{part}: mcap finds {count} messages, vrbench none")
    return False


if __name__ == "__main__":
    main()
