"""What recording costs: a 120 Hz headset, 1000 Hz motion capture and a 500 Hz robot.

    python benchmarks/recorder_load.py [--seconds 600]

Each source is a thread that stamps samples at its rate, as receivers of real devices do; the
recorder writes them into a take, which is read back. Prints what arrived, the processor time of it
all, sources included, and the memory at every tenth of the time.
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from vrbench.devices.host import RealClock
from vrbench.geometry import Transform
from vrbench.recording.recorder import record_take
from vrbench.recording.take import read_take
from vrbench.streams import GOOD, Columns, Joints, Samples

RATES = {"headset/eye": 120, "mocap/body": 1000, "robot/tcp": 500}


class Source:
    """Samples at a rate, numbered in their position's x."""

    def __init__(self, stream: str, rate_hz: int, host: RealClock) -> None:
        self.stream, self._period_ns, self._host = stream, 1_000_000_000 // rate_hz, host
        self.made = 0
        self._rows: list[tuple[int, int]] = []
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def start(self, _take: str) -> None:
        self._thread.start()

    def _run(self) -> None:
        due = self._host.now()
        while not self._over.is_set():
            now = self._host.now()
            with self._lock:
                while due <= now:  # a thread that woke late makes what a device would have sent
                    self._rows.append((due, self._host.now()))
                    self.made += 1
                    due += self._period_ns
            time.sleep(max(0.0, (due - self._host.now()) / 1e9))

    def read(self) -> Columns:
        with self._lock:
            rows, self._rows = self._rows, []
            first = self.made - len(rows)
        if not rows:
            return Columns({})
        n = len(rows)
        t, received = np.array(rows, dtype=np.int64).T
        p = np.zeros((n, 3))
        p[:, 0] = np.arange(first, first + n)
        q = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
        zeros = np.zeros(n, dtype=np.uint32)
        samples = Samples(t, t, received, Transform(p, q), zeros + np.uint32(GOOD), zeros)
        if not self.stream.startswith("robot"):
            return Columns({self.stream: samples})
        joints = Joints(t, received, np.zeros((n, 6)), np.zeros((n, 6)), tuple("abcdef"))
        return Columns({self.stream: samples}, joints={"robot/joints": joints})

    def stop(self) -> None:
        self._over.set()
        self._thread.join()


def cpu_s() -> float:
    """Processor time of this process, all threads [s]."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def resident_mb() -> float:
    """Memory of this process that is in use now [MB]; on Linux."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


def main() -> None:
    """Records, reads back, prints."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    seconds = parser.parse_args().seconds
    host = RealClock()
    sources = [Source(stream, rate, host) for stream, rate in RATES.items()]

    memory: list[float] = []

    def movement():
        begin = time.monotonic()
        while (done := (time.monotonic() - begin) / seconds) < 1.0:
            if len(memory) <= 10 * done:
                memory.append(resident_mb())
            yield done
            time.sleep(0.1)

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "load.mcap"
        wall, cpu = time.monotonic(), cpu_s()
        devices = {source.stream.partition("/")[0]: source for source in sources}
        record_take(path, {}, devices, movement(), host, lambda _: None)
        wall, cpu = time.monotonic() - wall, cpu_s() - cpu
        columns = read_take(path)
        size = path.stat().st_size
    lost = {}
    for source in sources:
        numbers = columns.poses[source.stream].pose.p[:, 0]
        assert np.array_equal(numbers, np.arange(len(numbers))), source.stream
        lost[source.stream] = source.made - len(numbers)
    told = {
        "seconds": round(wall, 1),
        "samples": {source.stream: source.made for source in sources},
        "joint states": len(columns.joints["robot/joints"]),
        "lost": lost,
        "cores": round(cpu / wall, 3),
        "resident megabytes": [round(mb, 1) for mb in memory],
        "megabytes": round(size / 1e6, 1),
    }
    print(json.dumps(told, indent=1))


if __name__ == "__main__":
    main()
