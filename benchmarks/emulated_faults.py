"""Lets things go wrong at random moments on a rig of emulated devices, and goes on after.

    python -m benchmarks.emulated_faults [--faults 24] [--kinds "Ctrl-C,kill -9"] [--seed 1]

Every run is recorded as in a lab: a UR5e over RTDE, Motive over NatNet and a headset over a
WebSocket, each a process of its own, and leave to move typed at a terminal. After every fault the
arm must be at rest, the run's record must say what came, every whole take must read back and match
its digest, and `--resume` must finish what may be gone on with. Takes about two minutes a fault, of
real time: on a computer that others load the robot falls behind, and runs end by that.
"""

from __future__ import annotations

import argparse
import random
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from tests.live.lab import Lab, Typed
from vrbench.recording.take import read_take
from vrbench.results.bundle import Bundle

SPAN_S = 75.0  # of a whole run, about
REST_S = 10.0
Fault = Callable[[Lab, Typed], None]


def _signal(typed: Typed, number: int) -> None:
    typed.process.send_signal(number)


FAULTS: dict[str, tuple[Fault, str]] = {
    "protective stop": (lambda lab, _: lab.arm.tell("protective"), "failed"),
    "emergency stop": (lambda lab, _: lab.arm.tell("estop"), "failed"),
    "safeguard stop": (lambda lab, _: lab.arm.tell("safeguard"), "failed"),
    "robot's link lost": (lambda lab, _: lab.arm.tell("drop"), "failed"),
    "headset gone": (lambda lab, _: lab.headset.kill(), "failed"),
    "headset hangs": (lambda lab, _: lab.headset.send_signal(signal.SIGSTOP), "failed"),
    "motion capture gone": (lambda lab, _: lab.motive.kill(), "failed"),
    "motion capture hangs": (lambda lab, _: lab.motive.send_signal(signal.SIGSTOP), "failed"),
    "Ctrl-C": (lambda _, typed: typed.interrupt(), "incomplete"),
    "SIGTERM": (lambda _, typed: _signal(typed, signal.SIGTERM), "incomplete"),
    "kill -9": (lambda _, typed: _signal(typed, signal.SIGKILL), "incomplete"),
}


def main() -> int:
    """Prints a row for every fault; 1 where anything wasn't as it must be."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--faults", type=int, default=24)
    parser.add_argument("--kinds", default=",".join(FAULTS), help="which, parted by commas")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    names = given.kinds.split(",")
    unknown = set(names) - set(FAULTS)
    if unknown:
        parser.error(f"--kinds: no {', '.join(sorted(unknown))}; there are {', '.join(FAULTS)}")
    rng = random.Random(given.seed)
    wrong = 0
    print("| fault | after | shown last | exit | run | takes | at rest | resumed |")
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as made:
        lab = Lab(Path(made))
        try:
            for number in range(given.faults):
                name, after = names[number % len(names)], rng.uniform(0.0, SPAN_S)
                row, bad = one(lab, name, after, Path(made) / f"run-{number}")
                print(
                    "| " + " | ".join(map(str, [name, f"{after:.1f} s", *row])) + " |", flush=True
                )
                for what in bad:
                    wrong += 1
                    print(f"  wrong: {what}", flush=True)
        finally:
            lab.close()
    print(f"{given.faults} faults, {wrong} things wrong")
    return int(bool(wrong))


def one(lab: Lab, name: str, after_s: float, run: Path) -> tuple[list[object], list[str]]:
    """A run, its fault, and what came of both: the cells of a row, and what was wrong."""
    do, expected = FAULTS[name]
    with lab.vrbench("record", run) as typed:
        typed.until(r"Type [0-9a-f]{12} to let it move")
        end = time.monotonic() + after_s
        while time.monotonic() < end and typed.read(0.05):
            pass
        shown = stage(typed.shown)
        done = typed.process.poll() is not None
        if not done:
            do(lab, typed)
        code = typed.end()
    bad = []
    rest = at_rest(lab)
    if rest is None:
        bad.append(f"the arm still moves {REST_S} s later")
    if "Traceback" in typed.shown:
        bad.append("a traceback: " + typed.shown[-2000:])
    status, takes, broken = told(run)
    bad += broken
    if not done and status not in (expected, "complete"):
        bad.append(f"the run is {status}, not {expected}: {typed.shown[-1500:]}")
    resumed = "-"
    lab.end_emulators()
    if status in ("incomplete", "failed"):
        with lab.vrbench("record", run, "--resume") as again:
            resumed = str(again.end())
        finished, _, broken = told(run)
        bad += broken
        if finished != "complete" and "given up" not in again.shown:
            bad.append(f"--resume left it {finished}: {again.shown[-1500:]}")
    rested = "no" if rest is None else f"{rest:.1f} s"
    return [shown, code, status, takes, rested, resumed], bad


def stage(shown: str) -> str:
    """Which take the terminal showed last, and how much of it."""
    last = [line for line in shown.replace("\r", "\n").splitlines() if "of 3" in line]
    return last[-1].strip()[:40].replace("|", "/") if last else "before the first take"


def at_rest(lab: Lab) -> float | None:
    """How long after the command's end the arm came to rest [s]; None where it doesn't."""
    begun = time.monotonic()
    while lab.moving():
        if time.monotonic() - begun > REST_S:
            return None
        time.sleep(0.05)
    return time.monotonic() - begun


def told(run: Path) -> tuple[str, str, list[str]]:
    """What the record says of the run and of its takes, and what of that isn't so."""
    if not (run / "run.json").is_file():
        return "none", "-", []
    bundle, bad = Bundle.begun(run), []
    for take in bundle.record.takes:
        if take.status == "ok":
            columns = bundle.columns(take)
            if not all(map(len, columns.poses.values())):
                bad.append(f"{take.file} has an empty stream")
    for path in (run / "takes").glob("*.part"):
        try:
            read_take(path)
        except Exception as error:  # whatever comes is the finding
            if path.stat().st_size > 4096:
                bad.append(f"{path.name}: {error}")
    statuses = [take.status for take in bundle.record.takes]
    return bundle.record.status, " ".join(statuses) or "none", bad


if __name__ == "__main__":
    sys.exit(main())
