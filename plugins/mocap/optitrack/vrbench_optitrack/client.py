"""Motive as a source of poses."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

import numpy as np

from vrbench.devices.ports import Session
from vrbench.devices.specs import MocapSpec
from vrbench.errors import DeviceError, VrbenchError
from vrbench.geometry import Bools, Floats, Ints, Transform, quat_normalize
from vrbench.streams import GOOD, Columns, Event, Samples
from vrbench.trajectory import NS, QUATERNION_TOLERANCE
from vrbench_optitrack.axes import pose_to_y_up, to_y_up
from vrbench_optitrack.check import check, no_answer, no_body, no_frames
from vrbench_optitrack.clock import exchanges_of, ticks_to_ns
from vrbench_optitrack.conversation import Conversation
from vrbench_optitrack.frames import decode_frame
from vrbench_optitrack.listener import Listener
from vrbench_optitrack.options import Options
from vrbench_optitrack.rows import Row
from vrbench_optitrack.stand_in import stand_in

ANSWER_S, FRAMES_S, MODELS_S = 2.0, 3.0, 3.0
SOURCES = ("mid-exposure", "data-received", "transmit", "arrival")
"""What a pose's time was taken from: the first of them that the frame has."""
EARLY_NS, LATE_NS = NS // 1000, 10 * NS
"""How much before its arrival a frame can't have been taken: in the future, or so long ago."""
IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class OptiTrack:
    """One rigid body of Motive, as `mocap/<body>`: right-handed, metres, y up.

    A pose's time is the middle of the cameras' exposure on the host's clock. Where the frame has
    none it is, in this order, when the data came to Motive, when the frame left, when it arrived;
    an event `pose-time` says which, at every change.
    """

    def __init__(self, options: Options, session: Session) -> None:
        self._options, self._session = options, session
        self._listener = Listener(options, session.host)
        self._stream = f"mocap/{topic_name(options.body)}"
        self._started = False
        self._events: list[Event] = []
        self._source: int | None = None
        self._shape: dict[str, Any] | None = None

    def __enter__(self) -> Self:
        self._listener.__enter__()
        try:
            talk, options = self._listener.talk, self._options
            self._await(lambda: talk.server is not None, ANSWER_S, lambda: no_answer(talk))
            self._await(
                lambda: talk.settled,
                MODELS_S,
                lambda: DeviceError(
                    "Motive sends no model definitions", fix="restart its streaming"
                ),
            )
            if talk.body is None:
                raise no_body(talk, options)
            self._await(
                lambda: bool(talk.rows), FRAMES_S, lambda: no_frames(talk, self._listener.interface)
            )
            # The first echo may have been slow: a few more, where there is a clock (NatNet 3).
            self._await(lambda: talk.clock is None or len(talk.echoes) > 3, 1.0, lambda: None)
        except BaseException:
            self._listener.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._listener.__exit__(kind, error, trace)

    def start(self, take: str) -> None:  # noqa: ARG002
        """Begins a take: what came before it is dropped, but for the clock's last two minutes."""
        talk = self._listener.talk
        with self._listener.lock:
            talk.rows.clear()
            talk.told.clear()
            talk.rows.overflown, talk.rows.collecting = 0, True
            now = self._session.host.now()
            self._events = [Event(now, "server", {**talk.described(), "clock": "optitrack"})]
            self._source = self._shape = None
            if talk.clock:
                talk.echoes.clear()
                talk.echoes.extend(talk.clock.kept())
            self._started = True

    def read(self) -> Columns:
        """Poses, clock exchanges and events since the last call.

        Raises:
            DeviceError: Motive fell silent, or sends what can't be read.
        """
        listener = self._listener
        with listener.lock:
            talk = listener.talk
            if not self._started:
                return Columns({})
            now = self._session.host.now()
            rows, echoes = talk.rows.settled(now), list(talk.echoes)
            talk.echoes.clear()
            self._events += [Event(*told) for told in talk.told]
            talk.told.clear()
            failure = listener.failure or talk.failure(now)
            self._tell_shape(talk)
            if talk.rows.overflown:
                lost = {"stream": "mocap", "frames": talk.rows.overflown, "why": "read too late"}
                self._events.append(Event(now, "gap", lost))
                talk.rows.overflown = 0
            # under the lock: the other thread takes echoes into the clocks that map the rows
            poses = {self._stream: self._samples(rows, talk.unit_mm)} if rows else {}
            clocks = {}
            if talk.clock is not None and echoes:
                clocks["optitrack"] = exchanges_of(echoes, talk.clock.frequency)
        if failure is not None and not rows:
            raise failure
        events, self._events = self._events, []
        return Columns(poses, events=events, clocks=clocks)

    def stop(self) -> None:
        """Ends a take: what came up to now can still be read."""
        with self._listener.lock:
            self._listener.talk.rows.collecting = False

    def _samples(self, rows: list[Row], unit_mm: float) -> Samples:
        n = len(rows)
        arrival = np.array([row.arrival for row in rows], dtype=np.int64)
        source_t, pose_t, source, sure = _times(rows, arrival)
        for i in np.flatnonzero(
            np.diff(source, prepend=-1 if self._source is None else self._source)
        ):
            told = {"stream": self._stream, "from": SOURCES[source[i]]}
            self._events.append(Event(int(arrival[i]), "pose-time", told))
        self._source = int(source[-1])
        values = np.array([IDENTITY if r.body is None else r.body[1:8] for r in rows])
        length = np.linalg.norm(values[:, 3:], axis=1)
        sane = np.isfinite(values).all(axis=1) & (np.abs(length - 1.0) < QUATERNION_TOLERANCE)
        values[~sane] = IDENTITY
        pose = Transform(values[:, :3] * (unit_mm * 1e-3), quat_normalize(values[:, 3:]))
        valid = np.array([row.valid for row in rows]) & sane & sure
        return Samples(
            source_t=source_t,
            pose_t=pose_t,
            receive_t=arrival,
            pose=pose_to_y_up(pose, self._options.up),
            flags=np.where(valid, GOOD, 0).astype(np.uint32),
            epoch=np.zeros(n, dtype=np.uint32),
        )

    def _tell_shape(self, talk: Conversation) -> None:
        """Where the markers sit about the pivot, at the start of a take and at every change."""
        if talk.version is not None and talk.version < (3, 0) and self._shape is not None:
            return  # measured in a frame, it would differ in every one
        shape = shape_of(talk, self._options)
        if shape is not None and shape != self._shape:
            now = self._session.host.now()
            self._events.append(Event(now, "body", {"stream": self._stream, **shape}))
            self._shape = shape

    def _await(
        self, done: Callable[[], bool], seconds: float, error: Callable[[], VrbenchError | None]
    ) -> None:
        """Waits until it is done; raises the error where it isn't in time."""
        end = time.monotonic() + seconds
        while True:
            with self._listener.lock:
                failure = self._listener.failure or self._listener.talk.failure(
                    self._session.host.now()
                )
                if done():
                    return
                late = time.monotonic() > end
                trouble = error() if late and failure is None else failure
            if trouble is not None:
                raise trouble
            if late:
                return
            time.sleep(0.01)


def _times(rows: list[Row], arrival: Ints) -> tuple[Ints, Ints, Ints, Bools]:
    """Source times, pose times on the host's clock, which of SOURCES they are from, which hold.

    A time after the frame's arrival, or long before it, is of a clock that has stepped: such a
    frame, and one that its source says may be stamped by another clock, has its arrival instead.
    """
    stamps = np.array([row.stamps for row in rows], dtype=np.uint64).astype(np.int64)
    there = (stamps > 0) & np.array([row.clock is not None for row in rows])[:, None]
    source = np.where(there.any(axis=1), np.argmax(there, axis=1), 3)
    chosen = np.take_along_axis(stamps, np.minimum(source, 2)[:, None], axis=1)[:, 0]
    source_t, pose_t = arrival.copy(), arrival.copy()
    for clock in {row.clock for row in rows}:
        if clock is None:
            continue
        of_it = np.array([row.clock is clock for row in rows]) & (source < 3)
        source_t[of_it] = ticks_to_ns(chosen[of_it], clock.frequency)
        pose_t[of_it] = clock.to_host(chosen[of_it])
    sure = np.array([row.sure for row in rows])
    sure &= (pose_t <= arrival + EARLY_NS) & (pose_t >= arrival - LATE_NS)
    return source_t, np.where(sure, pose_t, arrival), np.where(sure, source, 3), sure


def shape_of(talk: Conversation, options: Options) -> dict[str, Any] | None:
    """A body's id and its markers from the pivot [mm], y up, in JSON's types; None before known."""
    body = talk.body
    if body is None:
        return None
    offsets = body.markers or _carried(talk, body.id)
    markers = np.array(offsets, dtype=np.float64).reshape(-1, 3) * talk.unit_mm
    return {
        "name": body.name,
        "id": body.id,
        "markers_mm": to_y_up(markers, options.up).round(3).tolist(),
    }


def _carried(talk: Conversation, id_: int) -> Floats:
    """Markers (n, 3) from the pivot [server's unit]: before NatNet 3 the frames have them."""
    if talk.version is None or talk.version >= (3, 0) or not talk.newest:
        return np.zeros((0, 3))
    found = [b for b in decode_frame(talk.newest, talk.version).bodies if b.id == id_]
    if not found or not found[0].markers:
        return np.zeros((0, 3))
    pose = Transform.of(found[0].position, found[0].orientation)
    return pose.inverse().apply(np.array([marker.position for marker in found[0].markers]))


def topic_name(body: str) -> str:
    """A body's name as topics may have it: letters, digits and underscores."""
    name = "".join(c if c.isascii() and (c.isalnum() or c == "_") else "_" for c in body)
    return name if not name[0].isdigit() else f"_{name}"


OPTITRACK = MocapSpec(
    name="optitrack",
    title="OptiTrack Motive over NatNet 2.5 to 4.2",
    open=OptiTrack,
    rate_hz=240.0,
    options=Options,
    check=check,
    emulator="vrbench_optitrack.emulator",
    stand_in=stand_in,
)
