"""What a take gains from a headset that is elsewhere: samples, events, clock exchanges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vrbench.devices.follower import Answer, exchanges_of
from vrbench.devices.frames import COLUMNS, FLAGS, VELOCITIES, Frames, P, Q
from vrbench.geometry import Bools, Ints
from vrbench.streams import Columns, Event, Joints, Samples, believed
from vrbench.trajectory import NS

STREAM = "headset/eye"
TIMES = "headset/frames"
TIMES_NAMES = (*COLUMNS[:3], *COLUMNS[VELOCITIES])
# Frames this far apart are no frames dropped: the headset slept, or hid the session.
PAUSE_NS = NS // 4
NEVER = int(np.iinfo(np.int64).max)


class Gathering:
    """What one take gains. Not safe for threads.

    Args:
        start_t: when the take begins [ns]; None where there is no take, and nothing is gained.

    Attributes:
        taking: whether the take still gains what comes.
        stop_t: when it ended [ns]; None while it goes on.
    """

    def __init__(self, start_t: int | None = None) -> None:
        self.taking = start_t is not None
        self.stop_t: int | None = None
        self._start_t = start_t or 0
        self._last_t: int | None = None
        self._last_epoch: int | None = None
        self._samples: list[Samples] = []
        self._times: list[Joints] = []
        self._events: list[Event] = []
        self._answers: list[Answer] = []

    def finish(self, t: int) -> None:
        """The take gains nothing more; that frames were missing at its end is told."""
        since = self._start_t if self._last_t is None else self._last_t
        until = t if self.stop_t is None else self.stop_t
        if until - since > PAUSE_NS:
            seconds = round((until - since) / NS, 6)
            self.tell(t, "gap", {"kind": "end", "seconds": seconds})
        self.taking = False

    def tell(self, t: int, kind: str, detail: Mapping[str, Any]) -> None:
        """An event at `t` [ns]."""
        if self.taking:
            self._events.append(Event(t, kind, dict(detail)))

    def answered(self, answer: Answer) -> None:
        """A clock exchange."""
        if self.taking:
            self._answers.append(answer)

    def belongs(self, host: Ints) -> Bools:
        """Which frames (n,), made at `host` [ns] on the recorder's clock, are of the take."""
        end = NEVER if self.stop_t is None else self.stop_t
        return (host >= self._start_t) & (host <= end) & self.taking

    def add(self, frames: Frames, host: Ints, pose_t: Ints, sound: Bools) -> None:
        """Frames (n,), of which those of the take are kept.

        Args:
            frames: as they came.
            host: when they were made (n,) [ns], on the recorder's clock.
            pose_t: the times that their poses refer to (n,) [ns], on the recorder's clock.
            sound: which of them have times that can be relied on (n,); others are no good ones.
        """
        inside = self.belongs(host)
        if not inside.any():
            return
        frames, host = frames[inside], host[inside]
        rows = frames.rows
        pose, flags = believed(rows[:, P], rows[:, Q], rows[:, FLAGS] * sound[inside])
        self._tell_pauses(host, frames.epochs)
        receive_t = np.full(len(rows), frames.receive_t)
        self._samples.append(
            Samples(
                source_t=frames.called,
                pose_t=pose_t[inside],
                receive_t=receive_t,
                pose=pose,
                flags=flags,
                epoch=frames.epochs.astype(np.uint32),
            )
        )
        times = np.hstack((rows[:, :3], rows[:, VELOCITIES]))
        self._times.append(Joints(host, receive_t, times, np.zeros_like(times), TIMES_NAMES))

    def take(self) -> Columns:
        """What the take has gained since the last call."""
        samples, self._samples = self._samples, []
        times, self._times = self._times, []
        events, self._events = self._events, []
        answers, self._answers = self._answers, []
        return Columns(
            {STREAM: Samples.concatenate(samples)} if samples else {},
            joints={TIMES: _joined(times)} if times else {},
            events=events,
            clocks={"headset": exchanges_of(answers)} if answers else {},
        )

    def _tell_pauses(self, host: Ints, epochs: Ints) -> None:
        """Events of what lies between frames: silence, a new world."""
        before = host[0] if self._last_t is None else self._last_t
        steps = np.diff(host, prepend=before)
        for i in np.flatnonzero(steps > PAUSE_NS):
            seconds = round(float(steps[i]) / NS, 6)
            self.tell(int(host[i]), "gap", {"kind": "time", "seconds": seconds})
        self._last_t = int(host[-1])
        first = epochs[0] if self._last_epoch is None else self._last_epoch
        for i in np.flatnonzero(np.diff(epochs, prepend=first)):
            self.tell(int(host[i]), "recentre", {"epoch": int(epochs[i])})
        self._last_epoch = int(epochs[-1])


def _joined(parts: list[Joints]) -> Joints:
    return Joints(
        t=np.concatenate([x.t for x in parts]),
        receive_t=np.concatenate([x.receive_t for x in parts]),
        position=np.concatenate([x.position for x in parts]),
        velocity=np.concatenate([x.velocity for x in parts]),
        names=TIMES_NAMES,
    )
