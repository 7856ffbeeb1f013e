"""Ctrl-C while a take is recorded: noted, so that it cuts no write in two, and acted on soon."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any, Self


class Interrupt:
    """While entered, the first Ctrl-C (or SIGTERM) is noted; a second one is raised at once.

    What was noted is raised by `check`, or when it is left.

    Only the main thread hears signals; elsewhere nothing is changed.

    Attributes:
        asked: whether somebody wants to stop.
    """

    SIGNALS = (signal.SIGINT, signal.SIGTERM)

    def __init__(self) -> None:
        self.asked = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._before = {n: signal.signal(n, self._note) for n in self.SIGNALS}
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        if kind is None:
            self.check()

    def _note(self, _number: int, _frame: FrameType | None) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True

    def check(self) -> None:
        """Raises what was noted.

        Raises:
            KeyboardInterrupt: somebody wants to stop.
        """
        if self.asked:
            raise KeyboardInterrupt
