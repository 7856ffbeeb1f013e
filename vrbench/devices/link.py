"""One headset that is elsewhere, on its way into takes; public to authors of plugins.

No sockets in here: a route's receiver hands in what comes, with the time of receipt, and the route
takes out columns. Frames wait until the clock can tell their times (`DeviceClock`).
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from uuid import uuid4

import numpy as np

from vrbench.devices.follower import Answer, DeviceClock
from vrbench.devices.frames import EPOCH, FLAGS, MS, NOW, Frames
from vrbench.devices.gathering import Gathering
from vrbench.geometry import Bools, Floats, Ints
from vrbench.streams import GOOD, Columns
from vrbench.trajectory import NS

# Without frames for so long, the headset is asleep.
ASLEEP_NS = 3 * NS
# A frame can't have been made after it arrived; this much is granted to the fit of the clock.
FUTURE_NS = 20_000_000
# Batches of frames between takes whose times aren't known yet: of ten seconds and more at one frame
# each. The clock is known in the first of them, so more wait only where it never will be.
MOST_WAITING = 1000


@dataclass(slots=True, eq=False)
class _Run:
    """One run of the headset's app: its numbering and its clock start anew with it."""

    name: str
    origin_ns: int
    facts: Mapping[str, Any]
    expected: int | None = None
    last_event: int = -1
    last_now: float = -np.inf
    epochs: dict[int, int] = field(default_factory=dict)


class Link:
    """One headset and its frames; safe to use from two threads.

    Attributes:
        world: names the numbering of its epochs, which runs on over takes and runs of the app.
    """

    def __init__(self) -> None:
        self.world = uuid4().hex
        self._lock = threading.Lock()
        self._run: _Run | None = None
        self._clock = DeviceClock()
        self._epochs = 0
        self._waiting: deque[Frames] = deque()
        self._gathering = Gathering()
        self._confirmed_t = 0
        self._recent: deque[tuple[int, int, int]] = deque(maxlen=100)

    # What the receiver tells; t is always the time of receipt [ns] on the recorder's clock.

    def on_hello(self, run: str, origin_ns: int, facts: Mapping[str, Any], t: int) -> int | None:
        """An app connects, for the first time or again.

        Args:
            run: names this run of the app: a new one numbers its frames and epochs anew.
            origin_ns: what its milliseconds are counted from [ns].
            facts: of the device, for the take, in JSON's types.

        Returns:
            the number of the frame that is expected next; None where the run is new here.
        """
        with self._lock:
            known = self._run
            if known is None or known.name != run:
                if known is not None:
                    self._lose_clock(t, "the headset's app was started anew")
                known = self._run = _Run(run, origin_ns, facts)
                self._clock = DeviceClock()
            self._gathering.tell(t, "connection", {**facts, "state": "open"})
            return known.expected

    def on_closed(self, t: int, why: str) -> None:
        """The connection is gone; the app may come back with what it holds."""
        with self._lock:
            self._gathering.tell(t, "connection", {"state": "lost", "why": why})

    def on_refused(self, t: int, why: str) -> None:
        """Somebody was sent away, or a message was."""
        with self._lock:
            self._gathering.tell(t, "refused", {"why": why})

    def on_event(
        self, number: int, kind: str, at_ms: float, detail: Mapping[str, Any], t: int
    ) -> None:
        """Something happened on the headset; told once, however often its number comes."""
        with self._lock:
            run = self._run
            if run is None or number <= run.last_event:
                return
            run.last_event = number
            if self._clock.until is not None:
                at = run.origin_ns + round(at_ms * MS)
                t = min(t, int(self._clock.to_host(np.array([at]))[0]))
            self._gathering.tell(t, kind, detail)

    def on_answer(self, sent: int, received_ms: float, sent_ms: float, t: int) -> None:
        """The headset told its time, at a request that left at `sent` [ns]."""
        with self._lock:
            run = self._run
            if run is None:
                return
            received, answered = (run.origin_ns + round(ms * MS) for ms in (received_ms, sent_ms))
            answer = Answer(sent, received, answered, t)
            take = self._gathering
            take.answered(answer)
            if not self._clock.add(answer, at_once=take.taking and take.stop_t is not None):
                self._lose_clock(t, "the headset's clock stepped")
                self._clock.add(answer)
            self._confirm()

    def on_frames(self, first: int, rows: Floats, t: int) -> None:
        """Frames arrive; those that came before are passed by, those missing are told.

        Args:
            first: the number of the first; they are numbered without holes.
            rows: `COLUMNS` of each (n, 18), n > 0.
        """
        with self._lock:
            run = self._run
            if run is None:
                return
            expected, end = run.expected, first + len(rows)
            if expected is not None:
                if first > expected:
                    missing = first - expected
                    detail = {"kind": "sequence", "missing": missing, "first": expected}
                    self._gathering.tell(t, "gap", detail)
                rows = rows[max(0, expected - first) :]
            if not len(rows):
                return
            run.expected = end
            frames = Frames(rows, self._numbered(run, rows), t, run.origin_ns)
            now = rows[:, NOW]
            back = np.flatnonzero(np.diff(now, prepend=run.last_now) < 0)
            run.last_now = float(now[-1])
            self._recent.append((t, len(rows), int((rows[:, FLAGS] == GOOD).sum())))
            if len(back):
                # what is before the last such place is of a clock that is gone
                cut = int(back[-1])
                if cut:
                    self._waiting.append(frames[:cut])
                self._lose_clock(t, "frames go back in time")
                frames = frames[cut:]
            self._waiting.append(frames)
            if not self._gathering.taking and len(self._waiting) > MOST_WAITING:
                self._waiting.popleft()
            self._confirm()

    # What the route asks.

    @property
    def acknowledged(self) -> tuple[int | None, int]:
        """The frame expected next, and the last event: what need not be held any longer."""
        with self._lock:
            run = self._run
            return (None, -1) if run is None else (run.expected, run.last_event)

    @property
    def synchronised(self) -> bool:
        """Whether frames can be mapped to the recorder's clock."""
        return self._clock.until is not None

    @property
    def bound_s(self) -> float:
        """How wrong the headset's clock can be known at most [s]."""
        return self._clock.bound_ns / NS

    def rate(self, t: int) -> tuple[float, float]:
        """Frames a second over the last two seconds [Hz], and the part of them that was tracked."""
        with self._lock:
            recent = [x for x in self._recent if t - x[0] < 2 * NS]
        frames = sum(n for _, n, _ in recent)
        span = (recent[-1][0] - recent[0][0]) / NS if len(recent) > 1 else 0.0
        rate = sum(n for _, n, _ in recent[1:]) / span if span > 0 else 0.0
        return rate, sum(n for _, _, n in recent) / frames if frames else 0.0

    def awake(self, t: int) -> bool:
        """Whether frames have come lately."""
        with self._lock:
            return bool(self._recent) and t - self._recent[-1][0] < ASLEEP_NS

    def begin(self, t: int, facts: Mapping[str, Any]) -> None:
        """A take begins: frames made from now on belong to it.

        Args:
            t: the recorder's time [ns].
            facts: of headset and session, for the take, in JSON's types.
        """
        with self._lock:
            self._confirmed_t = 0
            self._gathering = Gathering(t)
            known = {} if self._run is None else dict(self._run.facts)
            self._gathering.tell(t, "headset", {**known, **facts, "clock_bound_s": self.bound_s})

    def end(self, t: int) -> None:
        """The take ends: frames made after this moment don't belong to it."""
        with self._lock:
            self._gathering.stop_t = t

    @property
    def complete(self) -> bool:
        """Whether all frames up to the end of the take are there, and their times known."""
        with self._lock:
            stop_t = self._gathering.stop_t
            return stop_t is not None and self._confirmed_t >= stop_t

    def finish(self, t: int) -> None:
        """Gives up what could not be told its time by now: it is recorded as not good."""
        with self._lock:
            self._give_up(t, "the connection ended before the clock could tell their times")
            self._gathering.finish(t)

    def tell(self, t: int, kind: str, detail: Mapping[str, Any]) -> None:
        """An event that the route knows of."""
        with self._lock:
            self._gathering.tell(t, kind, detail)

    def take(self) -> Columns:
        """What the take has gained since the last call."""
        with self._lock:
            return self._gathering.take()

    # Inside; the lock is held.

    def _numbered(self, run: _Run, rows: Floats) -> Ints:
        """Our own numbers of the app's epochs (n,): one more at every new one."""
        theirs = rows[:, EPOCH].astype(np.int64)
        for epoch in dict.fromkeys(theirs.tolist()):
            if epoch not in run.epochs:
                run.epochs[epoch] = self._epochs
                self._epochs += 1
        return np.array([run.epochs[epoch] for epoch in theirs.tolist()], dtype=np.int64)

    def _lose_clock(self, t: int, why: str) -> None:
        """The times of frames that wait can't be told any more, and the clock is followed anew."""
        self._give_up(t, why)
        self._clock = DeviceClock()
        self._gathering.tell(t, "clock", {"state": "lost", "why": why})

    def _confirm(self) -> None:
        """Passes on the frames whose times are known by now."""
        since, until = self._clock.since, self._clock.until
        while until is not None and since is not None and self._waiting:
            waiting = self._waiting[0]
            now = waiting.made
            ready = int(np.searchsorted(now, until, side="right"))
            if ready:
                self._pass_on(waiting[:ready], now[:ready] >= since)
            if ready < len(now):
                self._waiting[0] = waiting[ready:]
                break
            self._waiting.popleft()
        if until is not None:
            host = int(self._clock.to_host(np.array([until]))[0])
            self._confirmed_t = max(self._confirmed_t, host)

    def _give_up(self, t: int, why: str) -> None:
        """Frames that wait are recorded by their time of receipt, and none of them as good."""
        lost = 0
        for frames in self._waiting:
            n = len(frames)
            host = np.full(n, self._untold_t(frames))
            lost += n if self._gathering.belongs(host)[0] else 0
            arrived = np.full(n, frames.receive_t)
            self._gathering.add(frames, host, arrived, np.zeros(n, dtype=bool))
        self._waiting.clear()
        if lost:
            self._gathering.tell(t, "clock", {"state": "untold", "frames": lost, "why": why})

    def _pass_on(self, frames: Frames, known: Bools) -> None:
        """Frames whose times the clock knows, if they can't be from the future."""
        host = self._clock.to_host(frames.made)
        sound = known & (host <= frames.receive_t + FUTURE_NS)
        pose_t = np.where(sound, self._clock.to_host(frames.refers), frames.receive_t)
        self._gathering.add(frames, np.where(sound, host, self._untold_t(frames)), pose_t, sound)

    def _untold_t(self, frames: Frames) -> int:
        """The time of frames of which only their arrival is known; a take's end may lie before."""
        stop_t = self._gathering.stop_t
        if stop_t is None or self._confirmed_t >= stop_t:
            return frames.receive_t
        return min(frames.receive_t, stop_t)
