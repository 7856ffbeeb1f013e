"""Records: moves the robot, and writes what all devices send meanwhile into one take."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from vrbench.devices.ports import HostClock, PoseSource
from vrbench.recording.take import TakeWriter
from vrbench.streams import Columns, Event

# Poses received so far, by stream, and the part of the movement done, 0..1.
Progress = Callable[[Mapping[str, int], float], None]
SETTLE_S = 1.0


def record_take(
    path: Path,
    metadata: Mapping[str, str],
    sources: Sequence[PoseSource],
    movement: Generator[float],
    host: HostClock,
    progress: Progress,
) -> Mapping[str, int]:
    """Records one take while `movement` goes on.

    Args:
        path: where the take will be; its stem is the take's name.
        metadata: facts of the take.
        sources: everything that sends poses, connected.
        movement: yields the part done, often; moves the robot while it is iterated, and stops it
            when it is closed.
        host: the recorder's clock.
        progress: called after each look at the sources.

    Returns:
        poses received, by stream.

    Raises:
        DeviceError: a device failed; what came before stays in `<path>.part`.
    """
    received: Counter[str] = Counter()

    def drain(writer: TakeWriter) -> None:
        for source in sources:
            columns = source.read()
            received.update({stream: len(samples) for stream, samples in columns.poses.items()})
            writer.write(columns)

    def mark(writer: TakeWriter, phase: str) -> None:
        writer.write(Columns({}, events=[Event(host.now(), "phase", {"name": phase})]))

    with TakeWriter(path, metadata) as writer:
        with ExitStack() as running:
            for source in sources:
                source.start(path.stem)
                running.callback(source.stop)
            # Whatever happens, the movement is ended first: closing it stops the robot.
            running.callback(movement.close)
            host.wait(SETTLE_S)
            mark(writer, "move")
            for done in movement:
                drain(writer)
                progress(received, done)
            mark(writer, "rest")
            host.wait(SETTLE_S)
        drain(writer)
    return received
