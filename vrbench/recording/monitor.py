"""How a recording goes on: what each stream has sent, how fast, with which gaps, tracked or not."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from vrbench.streams import Samples
from vrbench.trajectory import MAX_GAP_PERIODS, NS

# The rate is that of the last moments.
RATE_NS = 3 * NS
# Steps that the usual one is the median of.
STEPS = 501
# Plans are told whole, ahead of time: they are no stream whose rate or gaps mean anything.
PLANNED = ("robot/target",)


@dataclass(frozen=True, slots=True)
class StreamState:
    """One stream, now.

    Attributes:
        stream: its name.
        received: poses so far.
        rate_hz: poses a second of late [Hz]; None before that can be told.
        gaps: places so far where poses are missing.
        tracked: part of the last moments' poses that are tracked, 0..1.
        silent_s: how long nothing has come [s].
    """

    stream: str
    received: int
    rate_hz: float | None
    gaps: int
    tracked: float
    silent_s: float


@dataclass(frozen=True, slots=True)
class Progress:
    """A take, now.

    Attributes:
        done: part of the movement, 0..1.
        left_s: how long it still takes [s]; None before that can be told.
        streams: all that send poses.
    """

    done: float
    left_s: float | None
    streams: Sequence[StreamState]


@dataclass(slots=True)
class _Stream:
    received: int = 0
    gaps: int = 0
    last_t: int | None = None
    heard: int = 0
    # of each look: when, poses, tracked ones, last stamp
    looks: deque[tuple[int, int, int, int]] = field(default_factory=deque)
    steps: deque[int] = field(default_factory=lambda: deque(maxlen=STEPS))


class Monitor:
    """Follows the streams of a take.

    Args:
        begin: when the movement begins [ns], recorder's clock.
    """

    def __init__(self, begin: int) -> None:
        self._begin = begin
        self._streams: dict[str, _Stream] = {}

    def add(self, poses: Mapping[str, Samples], now: int) -> None:
        """What has come by now [ns]."""
        for name, samples in poses.items():
            if len(samples) and name not in PLANNED:
                self._add(self._streams.setdefault(name, _Stream()), samples, now)

    def _add(self, stream: _Stream, samples: Samples, now: int) -> None:
        t = np.sort(samples.source_t)
        if stream.last_t is not None:
            t = np.concatenate(([stream.last_t], t))
        steps = np.diff(t)
        stream.steps.extend(steps[-STEPS:].tolist())
        if stream.steps:
            usual = float(np.median(stream.steps))
            stream.gaps += int(np.count_nonzero(steps > MAX_GAP_PERIODS * usual))
        stream.last_t, stream.heard = int(t[-1]), now
        stream.received += len(samples)
        good = int(np.count_nonzero(samples.good))
        stream.looks.append((now, len(samples), good, stream.last_t))
        while len(stream.looks) > 2 and now - stream.looks[1][0] > RATE_NS:
            stream.looks.popleft()

    def progress(self, done: float, now: int) -> Progress:
        """All of it, at `now` [ns]."""
        spent = (now - self._begin) / NS
        left = spent * (1.0 - done) / done if done > 0.0 else None
        states = [_state(name, stream, now) for name, stream in sorted(self._streams.items())]
        return Progress(done, left, states)

    def heard(self, name: str) -> int | None:
        """When the newest pose of a stream came [ns]; None before the first."""
        stream = self._streams.get(name)
        return None if stream is None else stream.heard

    @property
    def received(self) -> dict[str, int]:
        """Poses so far, by stream."""
        return {name: stream.received for name, stream in self._streams.items()}


def _state(name: str, stream: _Stream, now: int) -> StreamState:
    looks = list(stream.looks)
    poses = sum(n for _, n, *_ in looks)
    good = sum(n for _, _, n, _ in looks)
    span = looks[-1][3] - looks[0][3]
    return StreamState(
        stream=name,
        received=stream.received,
        rate_hz=(poses - looks[0][1]) * NS / span if span > 0 else None,
        gaps=stream.gaps,
        tracked=good / poses if poses else 0.0,
        silent_s=max(0.0, (now - stream.heard) / NS),
    )
