"""A page without a browser: what a headset would send, from a process of its own.

    python -m vrbench_webxr.emulator http://localhost:8765/TOKEN/

For trying a rig without a headset, and for tests, which set its clock and its poses at will.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import secrets
import ssl
import struct
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np

from vrbench.config.rig import Mounting
from vrbench.devices.emulated import EmulatedHead, StageReader
from vrbench.geometry import Floats, rotvec_to_quat
from vrbench_webxr import protocol

TRACKED = 15.0
# How long a page that isn't served waits before it tries again [s].
AGAIN_S = 0.5
# How often it looks where the robot has carried it meanwhile [s].
RIDE_S = 0.03


class FakePage:
    """Speaks the protocol as the page does: pinged, it sends what the recorder hasn't got yet.

    It holds frames and events until they are acknowledged, and sends them again over the next
    connection; but not what a connection carried that was closed with `BAD_MESSAGE`.

    Attributes:
        shift_ms: added to its clock; setting it makes the clock jump [ms].
        answers: whether it answers pings; a headset asleep doesn't.
        closed: the code and reason the recorder closed with; None while it is open.
        heard: messages of the recorder other than pings.
    """

    def __init__(self, url: str, *, page: str | None = None, **connecting: Any) -> None:
        self.page = page or secrets.token_hex(16)
        self.url = url
        self.shift_ms = 0.0
        self.answers = True
        self.closed: tuple[int, str] | None = None
        self.heard: list[dict[str, Any]] = []
        self.next = 0
        self._held: list[Floats] = []
        self._sent = 0
        self._events: list[dict[str, Any]] = []
        self._event_id = self._events_sent = 0
        self._connecting = connecting
        self._lock = threading.Lock()
        self._stack = contextlib.ExitStack()
        self._socket: Any = None
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        self.connect()
        return self

    def __exit__(self, *error: object) -> None:
        self.disconnect()

    def now_ms(self) -> float:
        """The time on its clock [ms]."""
        return time.perf_counter() * 1000.0 + self.shift_ms

    def connect(self, **hello: Any) -> None:
        """Connects and introduces itself; again with what it still holds."""
        from websockets.sync.client import connect

        address = self.url.replace("http", "ws", 1) + "ws"
        self.closed = None
        self._stack = contextlib.ExitStack()
        self._socket = self._stack.enter_context(
            connect(address, compression=None, proxy=None, **self._connecting)
        )
        self.say(
            {
                "type": "hello",
                "protocol": protocol.VERSION,
                "page": self.page,
                "origin_ms": 1_700_000_000_000.0,
                "client": "emulator",
                "agent": "vrbench emulator",
                "isolated": True,
                "webxr": True,
                **hello,
            }
        )
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def disconnect(self) -> None:
        """Closes the connection; what is held stays."""
        self._stack.close()
        if self._thread is not None:
            self._thread.join()

    def say(self, message: dict[str, Any]) -> None:
        """Sends a text message."""
        self._socket.send(json.dumps(message))

    def send_raw(self, data: bytes | str) -> None:
        """Sends anything."""
        self._socket.send(data)

    def begin_session(self, rate_hz: float = 90.0) -> None:
        """Says that a session runs."""
        self.tell("session-start", epoch=0)
        self.say(
            {
                "type": "state",
                "session": True,
                "mode": "immersive-vr",
                "space": "local",
                "visibility": "visible",
                "features": ["local", "local-floor", "viewer"],
                "rate_hz": rate_hz,
                "view": [-0.0315, 0, 0, 0, 0, 0, 1],
            }
        )

    def end_session(self) -> None:
        """Says that the session has ended."""
        self.tell("session-end")
        self.say({"type": "state", "session": False})

    def tell(self, kind: str, **detail: Any) -> None:
        """Holds an event, to be sent at the next ping."""
        event = {"type": "event", "kind": kind, "now_ms": self.now_ms(), "detail": detail}
        with self._lock:
            self._events.append({**event, "id": self._event_id})
            self._event_id += 1

    def frame(
        self,
        p: Sequence[float] | Floats,
        q: Sequence[float] | Floats,
        *,
        flags: float = TRACKED,
        epoch: float = 0.0,
        display_ms: float | None = None,
        at_ms: float | None = None,
    ) -> None:
        """Holds a frame made now, shown `display_ms` later, to be sent at the next ping.

        One that was made a moment ago says `at_ms`, when by its clock.
        """
        now = self.now_ms() if at_ms is None else at_ms
        shown = np.nan if display_ms is None else now + display_ms
        row = np.array([now, shown, now, *p, *q, *[np.nan] * 6, flags, epoch])
        with self._lock:
            self._held.append(row)
            self.next += 1

    def lose_frames(self, count: int) -> None:
        """Forgets the newest frames but not their numbers, as a full memory does."""
        with self._lock:
            del self._held[-count:]
            self.next -= count
            self._send_new()
            self._held.clear()
            self.next += count
            self._sent = self.next

    def _send_new(self) -> None:
        """Sends what this connection hasn't carried yet."""
        fresh = self._held[len(self._held) - (self.next - self._sent) :]
        if fresh:
            self._socket.send(batch(self._sent, np.array(fresh)))
            self._sent = self.next
        for event in self._events:
            if event["id"] >= self._events_sent:
                self.say(event)
        self._events_sent = self._event_id

    def _acknowledge(self, frame: int | None, event: int) -> None:
        """Forgets frames before this number, and events up to this one."""
        if frame is not None:
            kept = max(self.next - frame, 0)
            self._held = self._held[-kept:] if kept else []
        self._events = [x for x in self._events if x["id"] > event]

    def _listen(self) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            for text in self._socket:
                said = json.loads(text)
                received = self.now_ms()
                if said["type"] == "welcome":
                    with self._lock:
                        self._acknowledge(said["next"], -1)
                        self._sent, self._events_sent = self.next - len(self._held), 0
                if said["type"] != "ping":
                    self.heard.append(said)
                elif self.answers:
                    with self._lock:
                        self._acknowledge(said["next"], said["event"])
                        self._send_new()
                    times = {"received_ms": received, "sent_ms": self.now_ms()}
                    self.say({"type": "pong", "id": said["id"], **times})
        except ConnectionClosed:
            pass
        close = self._socket.protocol
        if close.close_code == protocol.BAD_MESSAGE:
            with self._lock:
                self._acknowledge(self._sent, self._events_sent - 1)
        self.closed = (close.close_code or 1006, close.close_reason or "")


def batch(first: int, rows: Floats) -> bytes:
    """A binary message of frames (n, 18)."""
    header = struct.pack("<4d", protocol.VERSION, first, len(rows), rows.shape[1])
    return header + np.ascontiguousarray(rows, dtype="<f8").tobytes()


def sway(t_s: float) -> tuple[Floats, Floats]:
    """Where a head that looks about is after t seconds: position [m], quaternion."""
    p = np.array([0.2 * np.sin(1.1 * t_s), 1.5 + 0.05 * np.sin(1.7 * t_s), 0.1 * np.sin(0.9 * t_s)])
    return p, rotvec_to_quat(
        np.array([0.3 * np.sin(1.3 * t_s), 0.6 * np.sin(0.7 * t_s), 0.1 * np.sin(2.1 * t_s)])
    )


def play(page: FakePage, rate_hz: float, going_on: Callable[[], bool]) -> None:
    """Makes frames at a rate while `going_on()`."""
    begin = due = time.perf_counter()
    while going_on() and page.closed is None:
        page.frame(*sway(due - begin), display_ms=1000.0 / rate_hz)
        due += 1.0 / rate_hz
        time.sleep(max(0.0, due - time.perf_counter()))


def ride(page: FakePage, head: EmulatedHead, rate_hz: float, going_on: Callable[[], bool]) -> None:
    """Makes frames at a rate of a head that an emulated robot carries, while `going_on()`."""
    period = round(1e9 / rate_hz)
    due = time.perf_counter_ns()
    while going_on() and page.closed is None:
        time.sleep(RIDE_S)
        now = time.perf_counter_ns()
        # where the robot was a second ago is forgotten soon: frames are left out instead
        frames = np.arange(max(due, now - round(1e9)), now, period)
        if len(frames):
            pose = head.eye(frames)
            for t, p, q in zip(frames.tolist(), pose.p, pose.q, strict=True):
                page.frame(p, q, at_ms=t / 1e6 + page.shift_ms)
            due = int(frames[-1]) + period


def main(arguments: Sequence[str] | None = None) -> None:
    """Plays a headset to the recorder at an address, for so long."""
    parser = argparse.ArgumentParser(prog="vrbench_webxr.emulator", description=main.__doc__)
    parser.add_argument("url", help="the address that the recorder printed")
    parser.add_argument("--rate", type=float, default=90.0, help="frames a second")
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument(
        "--stage", type=Path, help="an emulated robot's file: the headset rides on it"
    )
    parser.add_argument("--seed", type=int, default=1, help="of how it rides there, and errs")
    options = parser.parse_args(arguments)
    connecting: dict[str, Any] = {}
    if options.url.startswith("https"):
        connecting["ssl"] = ssl._create_unverified_context()  # its own certificate
    end = time.monotonic() + options.seconds

    def going_on() -> bool:
        return time.monotonic() < end

    with contextlib.suppress(KeyboardInterrupt):
        if options.stage is None:
            with FakePage(options.url, **connecting) as page:
                page.begin_session(options.rate)
                play(page, options.rate, going_on)
                if page.closed is None:
                    page.end_session()
            return
        stage = StageReader(options.stage)
        # late frames are for those who ask for them
        with contextlib.suppress(OSError):
            os.nice(-10)
        head = EmulatedHead(stage, Mounting().tcp_eye.transform(), options.seed)
        while going_on():
            # as a page does that somebody left open, it comes back whenever it is served
            with contextlib.suppress(OSError), FakePage(options.url, **connecting) as page:
                page.begin_session(options.rate)
                ride(page, head, options.rate, going_on)
            time.sleep(AGAIN_S)


if __name__ == "__main__":
    main()
