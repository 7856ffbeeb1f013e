"""Reads what a controller sends over RTDE, up to 500 times a second, and loses none of it.

ur-rtde's receiver keeps the last of several packets that wait; for a log every one counts. So this
is a plain client of its own: a thread takes bytes off the socket, `take` gives them as columns.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Self

import numpy as np

from vrbench.errors import DeviceError
from vrbench.geometry import Ints
from vrbench_ur import rtde

NAMES = (
    "timestamp",
    "actual_q",
    "actual_qd",
    "actual_TCP_pose",
    "target_q",
    "target_qd",
    "runtime_state",
    "safety_status_bits",
    "speed_scaling",
    "target_speed_fraction",
    "payload",
)
# Packets kept until somebody takes them: two minutes at 500 Hz.
BUFFER = 60_000
_DTYPES = {"DOUBLE": ">f8", "VECTOR6D": (">f8", 6), "VECTOR3D": (">f8", 3), "UINT32": ">u4"}


def _layout() -> np.dtype[Any]:
    fields: list[Any] = [("recipe", "u1")]
    for name in NAMES:
        kind = _DTYPES[rtde.OUTPUTS[name]]
        fields.append((name, *kind) if isinstance(kind, tuple) else (name, kind))
    return np.dtype(fields)


LAYOUT = _layout()


class Reader:
    """A connection to a controller's RTDE port.

    Args:
        host: the controller's address.
        rate_hz: how often it is to send [Hz].
        now: the host's clock [ns].
        timeout_s: for each answer of the handshake, and for a silence that counts as a loss [s].

    Raises:
        DeviceError: nobody answers, or what answers isn't a controller that sends all of this.
    """

    def __init__(
        self, host: str, rate_hz: float, now: Callable[[], int], timeout_s: float = 2.0
    ) -> None:
        self.host, self._now, self._timeout = host, now, timeout_s
        self._framing = rtde.Framing()
        self._packets: deque[tuple[int, bytes]] = deque()
        self._lock = threading.Lock()
        self.received = self.overflowed = 0
        self.lost: str | None = None
        self._last: bytes | None = None
        self._closing = False
        self.version = (0, 0, 0, 0)
        self._socket = self._connect()
        try:
            self._handshake(rate_hz)
        except BaseException:
            self._socket.close()
            raise
        self._thread = threading.Thread(target=self._run, name=f"rtde {host}", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _connect(self) -> socket.socket:
        try:
            connection = socket.create_connection((self.host, rtde.PORT_RTDE), self._timeout)
        except OSError as error:
            raise DeviceError(
                f"no controller answers at {self.host}, port {rtde.PORT_RTDE}",
                field="robot.options.host",
                fix=f"is it switched on, and the address right? {error}",
            ) from None
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connection

    def _ask(self, kind: int, payload: bytes = b"") -> bytes:
        """Sends a message and waits for the answer of its kind; others are passed by."""
        deadline = time.monotonic() + self._timeout
        try:
            self._socket.sendall(rtde.message(kind, payload))
            while time.monotonic() < deadline:
                for got, answer in self._framing.feed(self._receive()):
                    if got == kind:
                        return answer
            raise TimeoutError
        except TimeoutError:
            raise DeviceError(
                f"{self.host} accepts connections and stays mute",
                field="robot.options.host",
                fix="is this the robot's address? restart the controller if it is",
            ) from None
        except (OSError, ValueError) as error:
            raise DeviceError(
                f"{self.host} does not speak RTDE: {error}", field="robot.options.host"
            ) from None

    def _receive(self) -> bytes:
        data = self._socket.recv(65536)
        if not data:
            raise OSError("the connection was closed")
        return data

    def _handshake(self, rate_hz: float) -> None:
        if self._ask(rtde.VERSION_REQUEST, struct.pack(">H", rtde.PROTOCOL)) != b"\x01":
            raise DeviceError(
                f"{self.host} doesn't know RTDE protocol 2", fix="PolyScope 5 or newer is needed"
            )
        told = self._ask(rtde.CONTROLLER_VERSION)
        if len(told) >= 16:
            self.version = struct.unpack(">4I", told[:16])
        names = ",".join(NAMES) + ","
        answer = self._ask(rtde.SETUP_OUTPUTS, struct.pack(">d", rate_hz) + names.encode())
        kinds = answer[1:].decode(errors="replace").split(",")
        missing = [n for n, k in zip(NAMES, kinds, strict=False) if k != rtde.OUTPUTS[n]]
        if missing or len(kinds) != len(NAMES):
            raise DeviceError(
                f"{self.host} does not send {', '.join(missing) or 'what was asked for'}",
                fix="PolyScope 5.5 or newer is needed",
            )
        if self._ask(rtde.START) != b"\x01":
            raise DeviceError(f"{self.host} refuses to send", fix="restart the controller")

    def _run(self) -> None:
        """Takes packets off the socket until it is closed or silent for too long."""
        try:
            while not self._closing:
                data = self._receive()
                now = self._now()
                for kind, payload in self._framing.feed(data):
                    if kind == rtde.DATA and len(payload) == LAYOUT.itemsize:
                        self._keep(now, payload)
        except TimeoutError:
            self.lost = f"nothing came from {self.host} for {self._timeout:g} s"
        except (OSError, ValueError) as error:
            self.lost = f"the connection to {self.host} broke: {error}"

    def _keep(self, now: int, payload: bytes) -> None:
        with self._lock:
            self.received += 1
            self._last = payload
            if len(self._packets) >= BUFFER:
                # the newest goes: what is kept stays without a hole
                self.overflowed += 1
            else:
                self._packets.append((now, payload))

    def take(self) -> tuple[Ints, Any]:
        """Receive times (n,) [ns] and packets (n,) that came since the last call; at once."""
        with self._lock:
            got = list(self._packets)
            self._packets.clear()
        times = np.array([t for t, _ in got], dtype=np.int64)
        return times, np.frombuffer(b"".join(packet for _, packet in got), dtype=LAYOUT)

    def latest(self) -> Any:
        """The newest packet, taken or not; None before the first."""
        last = self._last
        return None if last is None else np.frombuffer(last, dtype=LAYOUT)[0]

    def close(self) -> None:
        """Ends the connection and the thread."""
        self._closing = True
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(self._timeout + 1.0)
        self._socket.close()
