"""A Motive that sees a body whose movements are known: for `vrbench plugin check optitrack`."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from vrbench.devices.rehearsal import LOST_EVERY_S, LOST_FROM_S, LOST_UNTIL_S, Rehearsal
from vrbench.geometry import Floats, Transform
from vrbench.trajectory import NS
from vrbench_optitrack.behaviour import Faults, ServerClock
from vrbench_optitrack.scene import Scene
from vrbench_optitrack.server import Server

VERSION = (4, 1)


@contextmanager
def stand_in(rehearsal: Rehearsal) -> Iterator[Mapping[str, Any]]:
    """Streams what Motive would stream, over loopback, in a thread."""
    over, begun = threading.Event(), threading.Event()
    # the emulator loses at the end of each period, the rehearsal in its midst
    first = rehearsal.began + round(LOST_UNTIL_S * NS)

    def carried(seconds: Floats) -> Transform:
        return rehearsal.pose(first + np.rint(seconds * NS).astype(np.int64))

    emulator = Server(
        scene=Scene(
            rate_hz=rehearsal.rate_hz,
            carried=carried,
            lose_every_s=LOST_EVERY_S,
            lose_s=LOST_UNTIL_S - LOST_FROM_S,
        ),
        version=VERSION,
        multicast=False,
        host="127.0.0.1",
        command_port=0,
        data_port=0,
        group="239.255.42.99",
        clock=ServerClock(10_000_000, 0.0, time.monotonic_ns(), 12_345_000_000),
        latency_s=0.006,
        jitter_s=0.0,
        timeout_s=5.0,
        faults=Faults(),
        seed=1,
    )
    emulator.open()

    def run() -> None:
        time.sleep(max(0.0, (first - rehearsal.now()) / NS))
        try:
            emulator.run(None, begun.set)
        except (OSError, ValueError):
            if not over.is_set():  # it ends by having its sockets closed
                raise
        finally:
            begun.set()

    thread = threading.Thread(target=run, name="vrbench stand-in", daemon=True)
    thread.start()
    try:
        begun.wait()
        yield {"body": "headset", "server": "127.0.0.1", "command_port": emulator.command_port}
    finally:
        over.set()
        emulator.close()
        thread.join(5.0)
