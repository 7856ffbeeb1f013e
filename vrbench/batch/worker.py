"""What a process of the pool runs: units come by standard input, outcomes go by standard output.

It lives as long as its input stays open, so that it ends with whoever started it, however that one
ends.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import time
from queue import SimpleQueue
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from vrbench.batch.unit import Unit

# How long a write that has begun may take until the process ends without it [s].
GRACE_S = 5.0


def main() -> None:
    """Performs units until the input ends."""
    # what plugins print must not get between the outcomes
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    units: SimpleQueue[Unit] = SimpleQueue()
    requests = os.fdopen(os.dup(0), "rb")
    threading.Thread(target=_listen, args=(requests, units), daemon=True).start()
    try:
        _work(units, answers)
    except (SystemExit, KeyboardInterrupt, BrokenPipeError):
        # no ordinary end while the thread reads
        os._exit(1)


def _listen(requests: BinaryIO, units: SimpleQueue[Unit]) -> None:
    """Takes units in; the end of the input is the end of the process."""
    try:
        while True:
            units.put(pickle.load(requests))
    except (EOFError, OSError, pickle.UnpicklingError):
        signal.raise_signal(signal.SIGTERM)
        time.sleep(GRACE_S)
        os._exit(1)


def _work(units: SimpleQueue[Unit], answers: BinaryIO) -> None:
    from vrbench.batch.unit import perform
    from vrbench.plugin.manager import Plugins

    def send(kind: str, content: object) -> None:
        pickle.dump((kind, content), answers)
        answers.flush()

    plugins = Plugins()
    while True:
        unit = units.get()
        send("outcome", perform(unit, lambda what, part: send("progress", (what, part)), plugins))
