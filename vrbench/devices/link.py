"""Frames of a headset that is elsewhere, on their way into a take; public to authors of plugins.

No sockets in here: a route's receiver hands in what comes, with the time of receipt, and the route
takes out columns. Frames wait until the clock can tell their times (`DeviceClock`).
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vrbench.devices.follower import Answer, DeviceClock, exchanges_of
from vrbench.geometry import Floats, Ints
from vrbench.streams import GOOD, Columns, Event, Joints, Samples, believed
from vrbench.trajectory import NS

# What a frame is: times [ms] on the headset's clock, a pose [m], velocities [m/s, rad/s].
COLUMNS = (
    "callback_ms",
    "display_ms",
    "now_ms",
    *("x", "y", "z"),
    *("qx", "qy", "qz", "qw"),
    *("vx", "vy", "vz"),
    *("wx", "wy", "wz"),
    "flags",
    "epoch",
)
CALLBACK, DISPLAY, NOW = 0, 1, 2
P, Q, VELOCITIES = slice(3, 6), slice(6, 10), slice(10, 16)
FLAGS, EPOCH = 16, 17

STREAM = "headset/eye"
TIMES = "headset/frames"
TIMES_NAMES = (*COLUMNS[:3], *COLUMNS[VELOCITIES])
MS = 1_000_000
# Frames this far apart are no frames dropped: the headset slept, or hid the session.
PAUSE_NS = NS // 4
# Without frames for so long, the headset is asleep.
ASLEEP_NS = 3 * NS
# A pose is for a display time near its frame; anything else is no display time.
FARTHEST_DISPLAY_MS = 1000.0
# A frame can't have been made after it arrived; this much is granted to the fit of the clock.
FUTURE_NS = 20_000_000


@dataclass(slots=True, eq=False)
class _Run:
    """One run of the headset's app: its numbering and its clock start anew with it."""

    origin_ns: int
    facts: Mapping[str, Any]
    expected: int | None = None
    last_event: int = -1
    last_now: float = -np.inf
    epochs: dict[int, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class _Waiting:
    """Frames whose times can't be told yet."""

    rows: Floats
    epochs: Ints
    receive_t: int
    origin_ns: int


class Link:
    """One headset and its frames; safe to use from two threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._run: _Run | None = None
        self._runs: dict[str, _Run] = {}
        self._clock = DeviceClock()
        self._epochs = 0
        self._epoch_of_last: int | None = None
        self._waiting: deque[_Waiting] = deque()
        self._taking = False
        self._start_t = 0
        self._stop_t: int | None = None
        self._confirmed_t = 0
        self._last_time: int | None = None
        self._samples: list[Samples] = []
        self._times: list[Joints] = []
        self._events: list[Event] = []
        self._answers: list[Answer] = []
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
            known = self._runs.get(run)
            if known is None:
                if self._run is not None:
                    self._lose_clock(t, "the headset's app was started anew")
                known = _Run(origin_ns, facts)
                self._runs = {run: known}
                self._clock = DeviceClock()
            self._run = known
            self._tell(t, "connection", {**facts, "state": "open"})
            return known.expected

    def on_closed(self, t: int, why: str) -> None:
        """The connection is gone; the app may come back with what it holds."""
        with self._lock:
            self._tell(t, "connection", {"state": "lost", "why": why})

    def on_refused(self, t: int, why: str) -> None:
        """Somebody was sent away, or a message was."""
        with self._lock:
            self._tell(t, "refused", {"why": why})

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
            self._tell(t, kind, detail)

    def on_answer(self, sent: int, received_ms: float, sent_ms: float, t: int) -> None:
        """The headset told its time, at a request that left at `sent` [ns]."""
        with self._lock:
            run = self._run
            if run is None:
                return
            received, answered = (run.origin_ns + round(ms * MS) for ms in (received_ms, sent_ms))
            answer = Answer(sent, received, answered, t)
            if self._taking:
                self._answers.append(answer)
            if not self._clock.add(answer, at_once=self._taking and self._stop_t is not None):
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
                    self._tell(
                        t, "gap", {"kind": "sequence", "missing": missing, "first": expected}
                    )
                rows = rows[max(0, expected - first) :]
            if not len(rows):
                return
            run.expected = end
            epochs = self._numbered(run, rows)
            now = rows[:, NOW]
            back = np.flatnonzero(np.diff(now, prepend=run.last_now) < 0)
            run.last_now = float(now[-1])
            self._recent.append((t, len(rows), int((rows[:, FLAGS] == GOOD).sum())))
            if len(back):
                # what is before the last such place is of a clock that is gone
                cut = int(back[-1])
                if cut:
                    self._waiting.append(_Waiting(rows[:cut], epochs[:cut], t, run.origin_ns))
                self._lose_clock(t, "frames go back in time")
                rows, epochs = rows[cut:], epochs[cut:]
            self._waiting.append(_Waiting(rows, epochs, t, run.origin_ns))
            if not self._taking and len(self._waiting) > 1000:
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
            self._taking, self._start_t, self._stop_t = True, t, None
            self._confirmed_t, self._last_time = 0, None
            self._samples, self._times, self._events, self._answers = [], [], [], []
            self._epoch_of_last = None
            known = {} if self._run is None else dict(self._run.facts)
            self._tell(t, "headset", {**known, **facts, "clock_bound_s": self.bound_s})

    def end(self, t: int) -> None:
        """The take ends: frames made after this moment don't belong to it."""
        with self._lock:
            self._stop_t = t

    @property
    def complete(self) -> bool:
        """Whether all frames up to the end of the take are there, and their times known."""
        with self._lock:
            return self._stop_t is not None and self._confirmed_t >= self._stop_t

    def finish(self, t: int) -> None:
        """Gives up what could not be told its time by now: it is recorded as not good."""
        with self._lock:
            self._give_up(t, "the connection ended before the clock could tell their times")
            since = self._start_t if self._last_time is None else self._last_time
            until = t if self._stop_t is None else self._stop_t
            if until - since > PAUSE_NS:
                seconds = round((until - since) / NS, 6)
                self._tell(t, "gap", {"kind": "end", "seconds": seconds})
            self._taking = False

    def mark(self, t: int, name: str) -> None:
        """A mark of the person at the PC."""
        with self._lock:
            self._tell(t, "mark", {"name": name})

    def tell(self, t: int, kind: str, detail: Mapping[str, Any]) -> None:
        """An event that the route knows of."""
        with self._lock:
            self._tell(t, kind, detail)

    def take(self) -> Columns:
        """What the take has gained since the last call."""
        with self._lock:
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

    # Inside; the lock is held.

    def _tell(self, t: int, event: str, detail: Mapping[str, Any]) -> None:
        if self._taking:
            self._events.append(Event(t, event, dict(detail)))

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
        self._tell(t, "clock", {"state": "lost", "why": why})

    def _confirm(self) -> None:
        """Passes on the frames whose times are known by now."""
        since, until = self._clock.since, self._clock.until
        while until is not None and since is not None and self._waiting:
            waiting = self._waiting[0]
            now = _ns(waiting.rows[:, NOW], waiting.origin_ns)
            ready = int(np.searchsorted(now, until, side="right"))
            if ready:
                self._pass_on(waiting, slice(0, ready), now[:ready], now[:ready] >= since)
            if ready < len(now):
                rest = slice(ready, None)
                self._waiting[0] = _Waiting(
                    waiting.rows[rest], waiting.epochs[rest], waiting.receive_t, waiting.origin_ns
                )
                break
            self._waiting.popleft()
        if until is not None:
            host = int(self._clock.to_host(np.array([until]))[0])
            self._confirmed_t = max(self._confirmed_t, host)

    def _give_up(self, t: int, why: str) -> None:
        """Frames that wait are recorded by their time of receipt, and none of them as good."""
        lost = 0
        for waiting in self._waiting:
            n = len(waiting.rows)
            host = np.full(n, self._untold_t(waiting))
            lost += n if self._belongs(host)[0] else 0
            arrived = np.full(n, waiting.receive_t)
            self._append(waiting, slice(None), host, arrived, np.zeros(n, dtype=bool))
        self._waiting.clear()
        if lost:
            self._tell(t, "clock", {"state": "untold", "frames": lost, "why": why})

    def _pass_on(self, waiting: _Waiting, part: slice, now: Ints, known: Any) -> None:
        rows = waiting.rows[part]
        host = self._clock.to_host(now)
        sound = known & (host <= waiting.receive_t + FUTURE_NS)
        display = rows[:, DISPLAY]
        ahead = display - rows[:, NOW]
        shown = np.isfinite(ahead) & (np.abs(ahead) < FARTHEST_DISPLAY_MS)
        refers = np.where(shown, display, rows[:, CALLBACK])
        pose_t = self._clock.to_host(_ns(refers, waiting.origin_ns))
        host = np.where(sound, host, self._untold_t(waiting))
        pose_t = np.where(sound, pose_t, waiting.receive_t)
        self._append(waiting, part, host, pose_t, sound)

    def _untold_t(self, waiting: _Waiting) -> int:
        """The time of frames of which only their arrival is known; a take's end may lie before."""
        if self._stop_t is None or self._confirmed_t >= self._stop_t:
            return waiting.receive_t
        return min(waiting.receive_t, self._stop_t)

    def _belongs(self, host: Ints) -> Any:
        end = np.iinfo(np.int64).max if self._stop_t is None else self._stop_t
        return (host >= self._start_t) & (host <= end) & self._taking

    def _append(self, waiting: _Waiting, part: slice, host: Ints, pose_t: Ints, sound: Any) -> None:
        inside = self._belongs(host)
        if not inside.any():
            return
        rows, epochs = waiting.rows[part][inside], waiting.epochs[part][inside]
        host, pose_t = host[inside], pose_t[inside]
        pose, flags = believed(rows[:, P], rows[:, Q], rows[:, FLAGS] * sound[inside])
        self._tell_pauses(host, epochs)
        n = len(rows)
        receive_t = np.full(n, waiting.receive_t)
        self._samples.append(
            Samples(
                source_t=_ns(rows[:, CALLBACK], waiting.origin_ns),
                pose_t=pose_t,
                receive_t=receive_t,
                pose=pose,
                flags=flags,
                epoch=epochs.astype(np.uint32),
            )
        )
        times = np.hstack((rows[:, :3], rows[:, VELOCITIES]))
        self._times.append(Joints(host, receive_t, times, np.zeros_like(times), TIMES_NAMES))

    def _tell_pauses(self, host: Ints, epochs: Ints) -> None:
        """Events of what lies between frames: silence, a new world."""
        before = host[0] if self._last_time is None else self._last_time
        steps = np.diff(host, prepend=before)
        for i in np.flatnonzero(steps > PAUSE_NS):
            seconds = round(float(steps[i]) / NS, 6)
            self._tell(int(host[i]), "gap", {"kind": "time", "seconds": seconds})
        self._last_time = int(host[-1])
        first = epochs[0] if self._epoch_of_last is None else self._epoch_of_last
        for i in np.flatnonzero(np.diff(epochs, prepend=first)):
            self._tell(int(host[i]), "recentre", {"epoch": int(epochs[i])})
        self._epoch_of_last = int(epochs[-1])


def _ns(ms: Floats, origin_ns: int) -> Ints:
    """Times [ns] on the headset's clock since 1970, of milliseconds after its origin."""
    return np.rint(ms * MS).astype(np.int64) + origin_ns


def _joined(parts: list[Joints]) -> Joints:
    return Joints(
        t=np.concatenate([x.t for x in parts]),
        receive_t=np.concatenate([x.receive_t for x in parts]),
        position=np.concatenate([x.position for x in parts]),
        velocity=np.concatenate([x.velocity for x in parts]),
        names=TIMES_NAMES,
    )
