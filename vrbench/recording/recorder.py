"""Records: moves the headset, and writes what all devices send meanwhile into one take."""

from __future__ import annotations

import errno
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from vrbench.devices.ports import HostClock, PoseSource, facts_of
from vrbench.errors import DeviceError
from vrbench.recording.guard import DiskWatch, HostWatch, disk_full
from vrbench.recording.interrupt import Interrupt
from vrbench.recording.monitor import Monitor, Progress
from vrbench.recording.take import TakeWriter
from vrbench.streams import Columns, Event
from vrbench.trajectory import NS

SETTLE_S = 1.0
# A device from which nothing comes for so long is lost; at a take's end, all should be there.
SILENT_S, SILENT_AT_END_S = 5.0, 1.0
# What poses come from, and nothing may be silent.
DEVICES = ("robot", "mocap", "headset")
# What moves the headset: whatever happens to it, nothing goes on.
MOVER = "robot"
# What the system says where there is no room to write.
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class TakeFailedError(DeviceError):
    """A device failed or was lost in mid-take; what came before stays in the take's `.part`.

    Args:
        device: which: `robot`, `mocap` or `headset`.
        error: what it said.
    """

    def __init__(self, device: str, error: DeviceError) -> None:
        super().__init__(error.what, file=error.file, field=error.field, fix=error.fix)
        self.device = device

    def __reduce__(self) -> tuple[object, ...]:
        error = DeviceError(self.what, file=self.file, field=self.field, fix=self.fix)
        return TakeFailedError, (self.device, error)


def record_take(
    path: Path,
    metadata: Mapping[str, str],
    sources: Mapping[str, PoseSource],
    movement: Generator[float],
    host: HostClock,
    progress: Callable[[Progress], None],
    *,
    carry_on: bool = False,
    notice: Callable[[str], None] = lambda _: None,
) -> Mapping[str, int]:
    """Records one take while `movement` goes on.

    Args:
        path: where the take will be; its stem is the take's name.
        metadata: facts of the take.
        sources: everything that sends poses, connected, by `robot`, `mocap`, `headset`; further
            ones may send events.
        movement: yields the part done, often; moves the robot while it is iterated, and stops it
            when it is closed.
        host: the recorder's clock.
        progress: called after each look at the sources.
        carry_on: whether the movement goes on to its end where a device other than the robot is
            lost. The take has failed all the same.
        notice: told of what people should know.

    Returns:
        poses received, by stream.

    Raises:
        TakeFailedError: a device failed, or was lost; what came before stays in `<path>.part`.
        DiskFullError: there is no room left; the same.
        KeyboardInterrupt: somebody pressed Ctrl-C; the same.
    """
    with _no_room_is_told(path), TakeWriter(path, metadata) as writer:
        take = _Take(writer, sources, host, progress, notice)
        with ExitStack() as running:
            for name, source in sources.items():
                with _blamed(name):
                    source.start(path.stem)
                running.callback(take.stop, name)
            interrupt = running.enter_context(Interrupt())
            # Whatever happens, the movement is ended first: closing it stops the robot.
            running.callback(movement.close)
            take.begin()
            host.wait(SETTLE_S)
            take.mark("move")
            for done in _moved(movement, interrupt):
                take.look(done, carry_on=carry_on)
            take.mark("rest")
            host.wait(SETTLE_S)
        take.end()
    return take.monitor.received


class _Take:
    """What goes on while one take is recorded."""

    def __init__(
        self,
        writer: TakeWriter,
        sources: Mapping[str, PoseSource],
        host: HostClock,
        progress: Callable[[Progress], None],
        notice: Callable[[str], None],
    ) -> None:
        self._writer, self._host = writer, host
        self._progress, self._notice = progress, notice
        self._sources = dict(sources)
        self._clock, self._disk = HostWatch(host), DiskWatch(writer.path.parent, host)
        self._heard: dict[str, int] = {}
        self._failure: TakeFailedError | None = None
        self._ended = 0
        self.monitor = Monitor(host.now())

    def begin(self) -> None:
        """All devices send by now."""
        self.monitor = Monitor(self._host.now())
        self._heard = dict.fromkeys(self._sources, self._host.now())
        self._disk.look()
        self._look_at_clock()
        if "headset" in self._sources:
            self._writer.tell(facts_of(self._sources["headset"]))

    def look(self, done: float, *, carry_on: bool) -> None:
        """Writes what has come since the last look."""
        for name in list(self._sources):
            try:
                self._read(name)
                self._check_silence(name, self._host.now(), SILENT_S)
            except TakeFailedError as failure:
                if not carry_on or name == MOVER:
                    raise
                self._failure = self._failure or failure
                del self._sources[name]
        self._look_at_clock()
        self._disk.look()
        self._progress(self.monitor.progress(done, self._host.now()))

    def mark(self, phase: str) -> None:
        """A phase begins."""
        self._writer.write(Columns({}, events=[Event(self._host.now(), "phase", {"name": phase})]))

    def stop(self, name: str) -> None:
        """A device need not send any more, and what it sent is written, whatever happened."""
        self._ended = self._ended or self._host.now()
        if name not in self._sources:
            return
        try:
            with _blamed(name):
                self._sources[name].stop()
            self._read(name)
        except TakeFailedError as failure:
            self._failure = self._failure or failure
            del self._sources[name]

    def end(self) -> None:
        """Nothing comes any more.

        Raises:
            TakeFailedError: a device was lost.
        """
        self._look_at_clock(now=True)
        for name in self._sources:
            self._check_silence(name, self._ended, SILENT_AT_END_S)
        if self._failure is not None:
            raise self._failure

    def _look_at_clock(self, *, now: bool = False) -> None:
        columns = self._clock.look(now=now)
        for event in columns.events:
            self._notice(
                f"the host's clock was stepped by {event.detail['seconds']:+.3f} s; "
                "the take's stamps go on as before"
            )
        self._writer.write(columns)

    def _read(self, name: str) -> None:
        with _blamed(name):
            columns = self._sources[name].read()
        self.monitor.add(columns.poses, self._host.now())
        for samples in columns.poses.values():
            if len(samples):
                self._heard[name] = max(self._heard[name], int(samples.receive_t.max()))
        self._writer.write(columns)

    def _check_silence(self, name: str, now: int, most_s: float) -> None:
        silent_s = (now - self._heard[name]) / NS
        if name in DEVICES and silent_s > most_s:
            raise TakeFailedError(
                name,
                DeviceError(
                    f"the {name} was lost: nothing came for {silent_s:.1f} s",
                    fix="is it still awake, running and in the network?",
                ),
            )


@contextmanager
def _blamed(device: str) -> Iterator[None]:
    """Says of which device an error is."""
    try:
        yield
    except TakeFailedError:
        raise
    except DeviceError as error:
        raise TakeFailedError(device, error) from error


@contextmanager
def _no_room_is_told(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if error.errno in NO_ROOM:
            raise disk_full(path.parent) from error
        raise


def _moved(movement: Generator[float], interrupt: Interrupt) -> Iterator[float]:
    """The movement; where it ends because somebody stopped it, that is what is told."""
    while True:
        interrupt.check()
        try:
            with _blamed(MOVER):
                done = next(movement, None)
        except TakeFailedError:
            interrupt.check()
            raise
        if done is None:
            return
        yield done
