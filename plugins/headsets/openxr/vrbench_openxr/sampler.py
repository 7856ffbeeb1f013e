"""Asks a runtime for the head's place at a steady rate, in a thread of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any, Self

from vrbench.errors import DeviceError
from vrbench_openxr.runtime import Located, Runtime


class Sampler:
    """Runs while it is entered; what it finds goes to the two functions, from its thread.

    Args:
        runtime: not entered yet; it is opened and asked in one thread.
        rate_hz: how often to ask [Hz].
        ahead_s: how far ahead of now a pose is asked for [s].
        on_pose: takes each pose.
        on_event: takes the kind and detail of each event.
    """

    def __init__(
        self,
        runtime: Runtime,
        *,
        rate_hz: float,
        ahead_s: float,
        on_pose: Callable[[Located], None],
        on_event: Callable[[str, dict[str, Any]], None],
    ) -> None:
        self.runtime = runtime
        self._period, self._ahead_ns = 1.0 / rate_hz, round(ahead_s * 1e9)
        self._on_pose, self._on_event = on_pose, on_event
        self._stop = threading.Event()
        self._opened = threading.Event()
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="vrbench-openxr", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self._opened.wait()
        if self._failure is not None:
            self._thread.join()
            raise self._failure
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._thread.join()

    @property
    def running(self) -> bool:
        """Whether the session goes on."""
        return self._thread.is_alive() and self.runtime.running

    def _run(self) -> None:
        with ExitStack() as stack:
            try:
                stack.enter_context(self.runtime)
            except BaseException as error:
                self._failure = error
                self._opened.set()
                return
            self._opened.set()
            try:
                self._sample()
            except Exception as error:  # the runtime may fail in any call
                what = error.what if isinstance(error, DeviceError) else f"{error}"
                self.runtime.running = False
                self._on_event("session-end", {"why": what[:200]})

    def _sample(self) -> None:
        due = time.perf_counter()
        while not self._stop.is_set():
            now = time.perf_counter()
            # before each pose: a recentre may come without notice, and starts an epoch
            for kind, detail in self.runtime.events():
                self._on_event(kind, detail)
            if self.runtime.running:
                self._on_pose(self.runtime.locate(self._ahead_ns))
            # after a pause, go on from now: what was missed can't be asked for any more
            due = max(due + self._period, now - self._period)
            # finer than waiting for the event would be on Windows; a period is at most 0.1 s
            time.sleep(max(0.0, due - time.perf_counter()))
