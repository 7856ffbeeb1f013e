"""How a run that is being recorded is shown: alive on a terminal, line by line in a pipe."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from vrbench.recording.monitor import Progress, StreamState

# How often a pipe is told of a take that goes on [s], and a terminal drawn anew.
EVERY_S, DRAW_S = 10.0, 0.2
SILENT_S = 1.0
TRACKED = 0.995


class RunDisplay:
    """A `vrbench.running.steps.Watcher` that shows what it is told on standard error."""

    def __init__(self, what: str, out: Console) -> None:
        self._what, self._out = what, out
        self._name, self._index, self._total = "", 0, 1
        self._told = 0.0
        self._live: Any = None
        self._quiet = False

    def __enter__(self) -> RunDisplay:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def take(self, name: str, index: int, total: int) -> None:
        """A take begins; until it moves, the terminal is an operator's."""
        self.close()
        self._name, self._index, self._total = name, index, total
        self._told = time.monotonic()
        if not self._out.is_terminal:
            self._out.print(f"{self._what}: take {index + 1} of {total}, {name}", soft_wrap=True)

    def moving(self, progress: Progress) -> None:
        """The take goes on."""
        now = time.monotonic()
        if self._quiet or now - self._told < (DRAW_S if self._out.is_terminal else EVERY_S):
            return
        self._told = now
        heading = self._heading(progress)
        if not self._out.is_terminal:
            streams = "; ".join(_line(stream) for stream in progress.streams)
            self._out.print(f"{heading}; {streams}", soft_wrap=True)
            return
        if self._live is None:
            from rich.live import Live

            self._live = Live(console=self._out, auto_refresh=False, transient=True)
            self._live.start()
        self._live.update(self._table(heading, progress), refresh=True)

    def notice(self, text: str) -> None:
        """A line that stays."""
        self._out.print(text, soft_wrap=True)

    @contextmanager
    def paused(self) -> Iterator[None]:
        """The terminal is somebody else's meanwhile."""
        self._quiet = True
        self.close()
        try:
            yield
        finally:
            self._quiet = False

    def close(self) -> None:
        """Nothing is shown any more, until a take goes on."""
        live, self._live = self._live, None
        if live is not None:
            live.stop()

    def _heading(self, progress: Progress) -> str:
        parts = [self._name, f"take {self._index + 1} of {self._total}"]
        parts.append(f"{100 * progress.done:.0f} %")
        if progress.left_s is not None:
            parts.append(f"{_clock(progress.left_s)} left")
        return ", ".join(parts)

    def _table(self, heading: str, progress: Progress) -> Any:
        from rich import box
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table

        table = Table(box=box.SIMPLE, pad_edge=False, show_edge=False)
        table.add_column("stream", no_wrap=True)
        for name in ("poses", "Hz", "gaps"):
            table.add_column(name, justify="right", no_wrap=True)
        table.add_column("tracking", no_wrap=True)
        for stream in progress.streams:
            rate = "" if stream.rate_hz is None else f"{stream.rate_hz:.1f}"
            cells = [stream.stream, str(stream.received), rate, str(stream.gaps), _state(stream)]
            table.add_row(*cells)
        width = max(20, min(60, self._out.width - 2))
        bar = ProgressBar(total=1.0, completed=progress.done, width=width)
        return Group(self._what, heading, bar, table)


def _line(stream: StreamState) -> str:
    rate = "" if stream.rate_hz is None else f" {stream.rate_hz:.1f} Hz"
    gaps = "1 gap" if stream.gaps == 1 else f"{stream.gaps} gaps"
    return f"{stream.stream}{rate}, {gaps}, {_state(stream)}"


def _state(stream: StreamState) -> str:
    """Tracking in a word or two."""
    if stream.silent_s > SILENT_S:
        return f"silent for {stream.silent_s:.0f} s"
    if stream.tracked >= TRACKED:
        return "tracked"
    return f"{100 * stream.tracked:.0f} % tracked" if stream.tracked else "lost"


def _clock(seconds: float) -> str:
    """Minutes and seconds, hours where there are any."""
    minutes, s = divmod(round(seconds), 60)
    hours, m = divmod(minutes, 60)
    return f"{hours}:{m:02d}:{s:02d}" if hours else f"{m}:{s:02d}"
