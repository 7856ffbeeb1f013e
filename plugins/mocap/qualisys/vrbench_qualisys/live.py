"""QTM as a source of poses, over its RT protocol: one rigid body, as `mocap/<body>`.

QTM tells when a frame was taken, in microseconds of its own clock, and answers no clock requests.
So its clock is had one way only: the frame that arrived soonest, of the last ten seconds, is taken
to have needed no time. Poses are late by that least delay, which stays the same; what is added to
it from frame to frame is taken out.
"""

from __future__ import annotations

import asyncio
import threading
import time
import xml.etree.ElementTree as ET
from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from vrbench.devices.ports import Finding, HostClock, Session
from vrbench.devices.specs import MocapSpec
from vrbench.errors import DeviceError, VrbenchError
from vrbench.geometry import Ints, Transform
from vrbench.streams import GOOD, Columns, Event, Samples
from vrbench.trajectory import NS
from vrbench_qualisys.axes import Up, is_rotation, poses_of, to_y_up

PORT = 22223
ANSWER_S, FRAMES_S, SILENCE_S = 3.0, 3.0, 5.0
ROWS = 60_000
WINDOW_S = 10


class Options(BaseModel):
    """Options of `mocap: {plugin: qualisys, options: ...}`."""

    model_config = ConfigDict(extra="forbid")

    server: str = Field(description="QTM's address")
    body: str = Field(min_length=1, description="the rigid body's name in QTM")
    port: int = Field(PORT, ge=1, le=65535, description="of QTM's RT server, little endian")
    up: Up = Field("z", description="the axis that is up in QTM")


class Row(NamedTuple):
    """A frame: when it came [ns], QTM's time [ns], position [mm], matrix, residual [mm]."""

    arrival: int
    stamp: int
    position: tuple[float, ...]
    matrix: tuple[float, ...]
    residual: float


class OneWayClock:
    """From QTM's time to the host's, by the least delay of each of the last ten seconds."""

    def __init__(self) -> None:
        self._least: deque[tuple[int, int]] = deque(maxlen=WINDOW_S)

    def add(self, stamp: int, arrival: int) -> None:
        """Takes in a frame: its stamp and its arrival [ns]."""
        second, behind = arrival // NS, arrival - stamp
        if self._least and self._least[-1][0] == second:
            behind = min(behind, self._least.pop()[1])
        self._least.append((second, behind))

    def to_host(self, stamps: Ints) -> Ints:
        """Stamps (n,) [ns] as host times [ns]."""
        return stamps + min(behind for _, behind in self._least)


class Receiver:
    """A thread with the connection in it.

    Attributes:
        rows: frames of the body; hold `lock` to look.
        bodies: names of QTM's bodies; None before they are known.
        failure: why the thread ended.
    """

    def __init__(self, options: Options, host: HostClock) -> None:
        self._options, self._host = options, host
        self.lock = threading.Lock()
        self.rows: deque[Row] = deque(maxlen=ROWS)
        self.clock = OneWayClock()
        self.bodies: list[str] | None = None
        self.failure: VrbenchError | None = None
        self.collecting = True
        self.heard_at = 0
        self._index = -1
        self._loop = asyncio.new_event_loop()
        self._end = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="qualisys", daemon=True)

    def open(self) -> None:
        """Begins."""
        self._thread.start()

    def close(self) -> None:
        """Ends the connection and the thread; nothing where they ended before."""
        if self._loop.is_closed():
            return
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join()
        self._loop.close()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._converse())
        except VrbenchError as error:
            self.failure = error
        except Exception as error:  # told to whoever reads, not to a log nobody sees
            self.failure = DeviceError(f"the connection to QTM failed: {error!r}")

    async def _converse(self) -> None:
        import qtm_rt

        host, port = self._options.server, self._options.port
        try:
            connection = await asyncio.wait_for(
                qtm_rt.connect(host, port, on_disconnect=self._lost), ANSWER_S
            )
        except TimeoutError:
            connection = None
        if connection is None:
            raise DeviceError(
                f"no answer from {host}:{port}",
                fix="is that QTM's address, and its real-time server on? Is the firewall open for "
                f"TCP {port}?",
            )
        try:
            answer = await connection.get_parameters(parameters=["6d"])
            names = [node.text or "" for node in ET.fromstring(answer).iterfind(".//Body/Name")]
            if self._options.body in names:
                self._index = names.index(self._options.body)
            self.bodies = names
            await connection.stream_frames(components=["6dres"], on_packet=self._packet)
            await self._end.wait()
            if self.failure is None:
                await connection.stream_frames_stop()
        finally:
            if self.failure is None:
                connection.disconnect()

    def _lost(self, _error: object) -> None:
        if not self._end.is_set():
            self.failure = DeviceError("QTM closed the connection", fix="is it still running?")
            self._end.set()

    def _packet(self, packet: Any) -> None:
        arrival = self._host.now()
        got = packet.get_6d_residual()
        with self.lock:
            self.heard_at = arrival
            if got is None or not 0 <= self._index < len(got[1]) or not self.collecting:
                return
            position, matrix, residual = got[1][self._index]
            stamp = int(packet.timestamp) * 1000
            self.clock.add(stamp, arrival)
            self.rows.append(
                Row(arrival, stamp, tuple(position), tuple(matrix.matrix), residual.residual)
            )


class Qualisys:
    """One rigid body of QTM: right-handed, metres, y up."""

    def __init__(self, options: Options, session: Session) -> None:
        self._options, self._session = options, session
        name = "".join(c if c.isascii() and c.isalnum() else "_" for c in options.body)
        self._stream = f"mocap/{name}"
        self._receiver = Receiver(options, session.host)
        self._events: list[Event] = []

    def __enter__(self) -> Self:
        self._receiver.open()
        try:
            for finding in _steps(self._receiver, self._options):
                if not finding.ok:
                    raise DeviceError(finding.what, fix=finding.fix)
        except BaseException:
            self._receiver.close()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self._receiver.close()

    def start(self, take: str) -> None:  # noqa: ARG002
        """Begins a take: what came before it is dropped."""
        receiver = self._receiver
        now = self._session.host.now()
        with receiver.lock:
            receiver.rows.clear()
            receiver.collecting, receiver.heard_at = True, now
        told = {"stream": self._stream, "from": "timestamp, least delay of 10 s"}
        self._events = [Event(now, "pose-time", told)]

    def read(self) -> Columns:
        """Poses since the last call.

        Raises:
            DeviceError: QTM fell silent, or closed the connection.
        """
        receiver = self._receiver
        with receiver.lock:
            rows = list(receiver.rows)
            receiver.rows.clear()
            silent = (self._session.host.now() - receiver.heard_at) / NS
        events, self._events = self._events, []
        if rows:
            return Columns({self._stream: self._samples(rows)}, events=events)
        if receiver.failure is not None:
            raise receiver.failure
        if receiver.collecting and silent > SILENCE_S:
            raise DeviceError(
                f"QTM has sent no frame for {silent:.1f} s", fix="is its measurement still running?"
            )
        return Columns({}, events=events)

    def stop(self) -> None:
        """Ends a take: what came up to now can still be read."""
        with self._receiver.lock:
            self._receiver.collecting = False

    def _samples(self, rows: list[Row]) -> Samples:
        arrival = np.array([row.arrival for row in rows], dtype=np.int64)
        stamp = np.array([row.stamp for row in rows], dtype=np.int64)
        position = np.array([row.position for row in rows], dtype=np.float64)
        matrix = np.array([row.matrix for row in rows], dtype=np.float64)
        residual = np.array([row.residual for row in rows], dtype=np.float64)
        good = is_rotation(matrix) & np.isfinite(position).all(axis=1) & (residual >= 0.0)
        position[~good], matrix[~good] = 0.0, np.eye(3).ravel()
        pose: Transform = to_y_up(poses_of(position, matrix), self._options.up)
        with self._receiver.lock:
            pose_t = self._receiver.clock.to_host(stamp)
        return Samples(
            source_t=stamp,
            pose_t=pose_t,
            receive_t=arrival,
            pose=pose,
            flags=np.where(good, GOOD, 0).astype(np.uint32),
            epoch=np.zeros(len(rows), dtype=np.uint32),
        )


def _steps(receiver: Receiver, options: Options) -> Iterator[Finding]:
    """From the network up to the body, as far as it goes."""
    _wait(receiver, lambda: receiver.bodies is not None, ANSWER_S + 1.0)
    if receiver.bodies is None:
        error = receiver.failure or DeviceError(
            "QTM doesn't tell its rigid bodies", fix="open a measurement in QTM"
        )
        yield Finding(False, error.what, error.fix or "")
        return
    yield Finding(True, f"QTM answers at {options.server}:{options.port}")
    if options.body not in receiver.bodies:
        there = ", ".join(map(repr, receiver.bodies)) or "none"
        yield Finding(False, f"QTM has no rigid body {options.body!r}", f"there are {there}")
        return
    _wait(receiver, lambda: len(receiver.rows) > 20, FRAMES_S)
    with receiver.lock:
        rows = list(receiver.rows)
    if not rows:
        yield Finding(
            False,
            "QTM answers, but sends no frames",
            "start a measurement or a preview; `Calculate 6DOF` in its real-time actions",
        )
        return
    yield Finding(True, f"body {options.body!r} comes, frame by frame")


def check(options: Options, session: Session) -> Iterator[Finding]:
    """What `vrbench rig check` finds about a QTM."""
    receiver = Receiver(options, session.host)
    receiver.open()
    try:
        fine = True
        for finding in _steps(receiver, options):
            fine &= finding.ok
            yield finding
        if not fine:
            return
        with receiver.lock:
            rows = list(receiver.rows)
        seen = is_rotation(np.array([row.matrix for row in rows], dtype=np.float64))
        part = 100.0 * float(np.mean(seen))
        yield Finding(
            part > 90.0,
            f"{options.body!r} is tracked in {part:.0f} % of frames",
            "" if part > 90.0 else "is it in view of the cameras, and its definition right?",
        )
        yield Finding(
            True, "QTM answers no clock requests: poses are late by the least delay, unknown"
        )
    finally:
        receiver.close()


def _wait(receiver: Receiver, done: Any, seconds: float) -> None:
    end = time.monotonic() + seconds
    while not done() and receiver.failure is None and time.monotonic() < end:
        time.sleep(0.01)


QUALISYS = MocapSpec(
    name="qualisys",
    title="Qualisys QTM over its RT protocol",
    open=Qualisys,
    rate_hz=240.0,
    options=Options,
    check=check,
)
