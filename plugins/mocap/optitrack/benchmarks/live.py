"""A stream over loopback from the emulator: lost frames, CPU share, error of the clock.

python benchmarks/live.py [SECONDS] [RATE] [SKEW_PPM]
"""

from __future__ import annotations

import json
import subprocess
import sys
import time

import numpy as np
from vrbench_optitrack.behaviour import ServerClock
from vrbench_optitrack.client import OptiTrack
from vrbench_optitrack.options import Options

from vrbench.devices.ports import Session
from vrbench.geometry import Transform

NS = 1_000_000_000


class MonotonicClock:
    """The emulator's reference."""

    def now(self) -> int:
        return time.monotonic_ns()

    def wait(self, seconds: float) -> None:
        time.sleep(seconds)


def main() -> None:
    given = [float(x) for x in sys.argv[1:]]
    seconds, rate, skew = given + [60.0, 1000.0, 50.0][len(given) :]
    command = [sys.executable, "-m", "vrbench_optitrack.emulator", "--rate", str(rate)]
    command += ["--skew-ppm", str(skew), "--command-port", "0", "--data-port", "0"]
    command += ["--markers", "100", "--duration", str(seconds + 10)]
    emulator = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert emulator.stdout is not None
        said = json.loads(emulator.stdout.readline())
        truth = ServerClock(**said["clock"])
        options = Options(body="headset", server="127.0.0.1", command_port=said["command_port"])
        with OptiTrack(options, Session(MonotonicClock(), Transform.identity(), 1)) as source:
            stream(source, truth, seconds)
    finally:
        emulator.terminate()
        emulator.wait()


def stream(source: OptiTrack, truth: ServerClock, seconds: float) -> None:
    source.start("take")
    cpu, began = time.process_time(), time.monotonic()
    got = lost = 0
    errors: list[float] = []
    shown = 0.0
    while (since := time.monotonic() - began) < seconds:
        time.sleep(0.05)
        columns = source.read()
        for samples in columns.poses.values():
            got += len(samples)
            exposed = (samples.source_t * (truth.frequency / NS) - truth.ticks) / truth.frequency
            host = truth.reference_ns + exposed / (1 + truth.skew_ppm * 1e-6) * NS
            errors += ((samples.pose_t - host) / 1e6).tolist()
        lost += sum(event.detail["frames"] for event in columns.events if event.kind == "gap")
        if since - shown >= 10.0:
            shown = since
            tell(source, truth, since, errors)
            errors = []
    share = (time.process_time() - cpu) / (time.monotonic() - began)
    tell(source, truth, seconds, errors)
    print(f"{got} frames, {lost} lost, {100 * share:.1f} % of a core")


def tell(source: OptiTrack, truth: ServerClock, since: float, errors: list[float]) -> None:
    clock = source._listener.talk.clock
    assert clock is not None
    worst = np.abs(errors).max() if errors else float("nan")
    fit = clock.fit()
    print(
        f"after {since:3.0f} s: skew {clock.skew_ppm:.3f} ppm of {truth.skew_ppm:g}; pose times of "
        f"10 s off by {np.mean(errors) * 1e3:.0f} us, at most {worst * 1e3:.0f} us; bound "
        f"{fit.bound_s * 1e6:.0f} us, residual {fit.residual_s * 1e6:.0f} us",
        flush=True,
    )


if __name__ == "__main__":
    main()
