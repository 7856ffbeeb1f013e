"""A pool of processes: one unit at a time each; what ends one of them costs its unit alone.

`concurrent.futures` gives up a whole pool when one process dies, and cannot say whose unit it had.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue
from signal import Signals

from vrbench.batch.threads import ONE_THREAD
from vrbench.batch.unit import Outcome, Tell, Unit
from vrbench.errors import DataError

# How long a process may take to end what it writes [s].
PATIENCE_S = 10.0
# Told of a unit that goes on: which, what it does, and which part is done.
Watch = Callable[[Unit, str, float], None]


class Worker:
    """A process that performs units, one after the other; a dead one is replaced."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = False
        self._lock = threading.Lock()

    def perform(self, unit: Unit, tell: Tell) -> Outcome:
        """Has the unit done; the death of the process is an outcome too."""
        process = self._alive()
        if process is None:
            return Outcome(unit, error=DataError("was not begun", file=unit.run))
        assert process.stdin is not None and process.stdout is not None
        try:
            pickle.dump(unit, process.stdin)
            process.stdin.flush()
            while True:
                kind, content = pickle.load(process.stdout)
                if kind == "outcome":
                    assert isinstance(content, Outcome)
                    return content
                tell(*content)
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            code = _ended(process)
        process.stdout.close()
        self._process = None
        why = f"by signal {_signal(-code)}" if code < 0 else f"with code {code}"
        return Outcome(
            unit,
            error=DataError(
                f"the process that evaluated it ended {why}",
                file=unit.run,
                fix="SIGKILL is how a system that is out of memory ends processes",
            ),
        )

    def _alive(self) -> subprocess.Popen[bytes] | None:
        with self._lock:
            if self._process is None and not self._stopped:
                self._process = subprocess.Popen(
                    [sys.executable, "-P", "-c", "from vrbench.batch.worker import main; main()"],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    env={**os.environ, **ONE_THREAD, "PYTHONPATH": os.pathsep.join(sys.path)},
                    # Ctrl-C is for the one who started it, and who stops it
                    process_group=None if sys.platform == "win32" else 0,
                )
            return None if self._stopped else self._process

    def stop(self) -> None:
        """Ends the process; a write that has begun is ended first."""
        with self._lock:
            self._stopped = True
            if self._process is not None:
                self._process.terminate()
                _ended(self._process)


def _ended(process: subprocess.Popen[bytes]) -> int:
    """Waits for the process to end, or ends it."""
    assert process.stdin is not None
    with suppress(OSError):  # it is gone, with something unsent
        process.stdin.close()
    with suppress(subprocess.TimeoutExpired):
        process.wait(PATIENCE_S)
    process.kill()
    return process.wait()


def _signal(number: int) -> str:
    try:
        return f"{number} ({Signals(number).name})"
    except ValueError:
        return str(number)


def perform_apart(unit: Unit) -> Outcome:
    """Has one unit done in a process of its own, which ends with it: what a cluster's worker does.

    So it computes in one thread whatever its worker does, and other units beside it don't matter.
    """
    worker = Worker()
    try:
        return worker.perform(unit, lambda *_: None)
    finally:
        worker.stop()


def perform_all(units: Sequence[Unit], jobs: int, watch: Watch) -> Iterator[Outcome]:
    """Has all units done, so many at a time; yields outcomes as they come.

    However it is left, none of its processes lives on.
    """
    waiting: SimpleQueue[Unit] = SimpleQueue()
    for unit in units:
        waiting.put(unit)
    outcomes: SimpleQueue[Outcome] = SimpleQueue()
    workers = [Worker() for _ in range(min(jobs, len(units)))]

    def serve(worker: Worker) -> None:
        while True:
            try:
                unit = waiting.get_nowait()
            except Empty:
                break
            try:
                done = worker.perform(unit, partial(watch, unit))
            except Exception as error:  # nobody would hear of it
                done = Outcome(unit, error=DataError(f"no process: {error}", file=unit.run))
            outcomes.put(done)
        worker.stop()

    threads = [threading.Thread(target=serve, args=(one,), daemon=True) for one in workers]
    try:
        for thread in threads:
            thread.start()
        for _ in units:
            yield outcomes.get()
    finally:
        with suppress(Empty):
            while True:
                waiting.get_nowait()
        for worker in workers:
            worker.stop()
