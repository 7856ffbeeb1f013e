"""The receiver: one thread that listens to one logger by UDP, and commands it.

A datagram counts only with the right token, and only from the first address that had it.
"""

from __future__ import annotations

import contextlib
import secrets
import socket
import threading
import time
from typing import Any, Self

from vrbench.devices.link import Link
from vrbench.devices.ports import HostClock
from vrbench.errors import DeviceError
from vrbench.trajectory import NS
from vrbench_quest import wire
from vrbench_quest.wire import MOMENTS, WireError

PING_S = 0.1
REPEAT_S = 0.05
SILENT_NS = 3 * NS
# A flood of strange datagrams is told as one event in so long.
QUIET_NS = NS


class Receiver:
    """Listens while it is entered.

    Args:
        link: told of everything that comes in.
        host: the recorder's clock.
        address: to listen at.
        port: to listen at; 0 is any free one, and `port` says which.
        token: of the session, which the logger was given.
        moment: which samples are taken: `update` or `render`.
    """

    def __init__(
        self, link: Link, host: HostClock, *, address: str, port: int, token: bytes, moment: str
    ) -> None:
        self.port = port
        self.facts: dict[str, Any] | None = None
        self._link, self._host, self._address = link, host, address
        self._token, self._take_token = token, b""
        self._moment = MOMENTS[moment]
        self._sender: tuple[str, int] | None = None
        self._heard = 0
        self._told = 0
        self._lost = True
        self._next = 0
        self._numbered = 0
        self._pings: dict[int, int] = {}
        # a logger obeys each number once, and may outlive this recorder
        self._command = secrets.randbelow(2**31)
        self._done: set[int] = set()
        self._stop = threading.Event()
        self._socket: socket.socket
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        family = socket.AF_INET6 if ":" in self._address else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.bind((self._address, self.port))
        except OSError as error:
            self._socket.close()
            raise DeviceError(
                f"can't listen at {self._address}:{self.port}: {error}",
                field="headset.options.listen",
                fix="an address of this PC, and a port that nothing else uses",
            ) from error
        self._socket.settimeout(0.1)
        self.port = self._socket.getsockname()[1]
        for run in (self._listen, self._ask):
            thread = threading.Thread(target=run, name=f"vrbench-quest {run.__name__}", daemon=True)
            thread.start()
            self._threads.append(thread)
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self._socket.close()

    @property
    def connected(self) -> bool:
        """Whether a logger has been heard lately."""
        return self._sender is not None and self._host.now() - self._heard < SILENT_NS

    def start(self, take: str, seconds: float) -> bool:
        """Tells the logger to send and log a take; whether it has said that it does."""
        self._take_token = secrets.token_bytes(wire.TOKEN_BYTES)
        self._next = 0
        return self._order(wire.START, self._take_token + take.encode()[:200], seconds)

    def stop(self, seconds: float) -> bool:
        """Tells the logger to end the take; whether it has said that it did."""
        return self._order(wire.STOP, b"", seconds)

    def _order(self, kind: int, body: bytes, seconds: float) -> bool:
        """Sends a command, again and again, until it is answered or time is up."""
        self._command += 1
        number = self._command
        end = time.monotonic() + seconds
        while number not in self._done and time.monotonic() < end and not self._stop.is_set():
            self._send(kind, wire.COMMAND.pack(number) + body)
            time.sleep(REPEAT_S)
        return number in self._done

    def _send(self, kind: int, body: bytes) -> None:
        if self._sender is not None:
            with contextlib.suppress(OSError):  # the network is away; what is asked is repeated
                self._socket.sendto(wire.pack(kind, self._token, body), self._sender)

    def _ask(self) -> None:
        """Asks for the logger's time, ten times a second."""
        number = 0
        while not self._stop.wait(PING_S if number > 10 else PING_S / 5):
            if self._sender is None:
                continue
            number += 1
            self._pings[number] = self._host.now()
            self._pings.pop(number - 50, None)
            self._send(wire.PING, wire.COMMAND.pack(number))
            if not self.connected and not self._lost:
                self._lost = True
                self._link.on_closed(self._host.now(), "the logger is silent")

    def _listen(self) -> None:
        while not self._stop.is_set():
            try:
                data, sender = self._socket.recvfrom(2048)
            except TimeoutError:
                continue
            except OSError:  # an answer of the network to what we sent
                continue
            now = self._host.now()
            try:
                self._take_in(wire.unpack(data), sender[:2], now)
            except WireError as error:
                self._refuse(str(error), now)

    def _refuse(self, why: str, now: int) -> None:
        if now - self._told > QUIET_NS:
            self._told = now
            self._link.on_refused(now, why)

    def _take_in(self, datagram: wire.Datagram, sender: tuple[str, int], now: int) -> None:
        wanted = self._take_token if datagram.kind == wire.POSES else self._token
        if not wanted or not secrets.compare_digest(datagram.token, wanted):
            late = datagram.kind == wire.POSES and sender == self._sender
            return None if late else self._refuse("a datagram without the token", now)
        if datagram.kind == wire.HELLO and not self.connected:
            self._sender = sender  # an app started anew has another port
        if sender != self._sender:
            return self._refuse(f"a second sender, {sender[0]}", now)
        self._heard = now
        if datagram.kind == wire.HELLO:
            self._greet(wire.facts_of(datagram.body), now)
        elif self.facts is None:
            raise WireError("a datagram before any greeting")
        elif datagram.kind == wire.POSES:
            self._poses(datagram.body, now)
        elif datagram.kind == wire.PONG:
            number, received, sent = _unpack(wire.PONG_BODY, datagram.body)
            wire.check_times(received, sent)
            asked = self._pings.pop(number, None)
            if asked is not None:
                self._link.on_answer(asked, received / 1e6, sent / 1e6, now)
        elif datagram.kind == wire.DONE:
            self._done.add(_unpack(wire.COMMAND, datagram.body)[0])
        elif datagram.kind == wire.EVENT:
            number, at = _unpack(wire.EVENT_BODY, datagram.body)
            wire.check_times(at)
            text = datagram.body[wire.EVENT_BODY.size :].decode(errors="replace")
            kind, _, detail = text.partition(" ")
            self._link.on_event(number, kind[:40] or "note", at / 1e6, {"detail": detail}, now)
        else:
            raise WireError(f"a datagram of kind {datagram.kind}")
        return None

    def _greet(self, facts: dict[str, Any], now: int) -> None:
        """A logger greets every second; that it is another run, or back again, is told."""
        if self.facts is None or facts["run"] != self.facts["run"] or self._lost:
            origin = facts.get("utc_origin_ns", 0)
            if not isinstance(origin, int) or abs(origin) > 2**62:
                raise WireError("a greeting with another origin of time")
            told = {key: value for key, value in facts.items() if key != "run"}
            self._link.on_hello(facts["run"], origin, told, now)
            self._lost = False
        self.facts = facts

    def _poses(self, body: bytes, now: int) -> None:
        """Samples of the moment that is wanted, numbered anew as they come.

        Both moments share one numbering, so that a datagram lost is seen; one that comes late is
        passed by, and is then a gap.
        """
        first, samples = wire.poses_of(body)
        if first < self._next:
            return
        self._numbered += first - self._next
        self._next = first + len(samples)
        chosen = samples[samples["moment"] == self._moment]
        if len(chosen):
            self._link.on_frames(self._numbered, wire.frames_of(chosen), now)
            self._numbered += len(chosen)


def _unpack(shape: Any, body: bytes) -> tuple[Any, ...]:
    if len(body) < shape.size:
        raise WireError(f"a datagram of {len(body)} bytes")
    return tuple(shape.unpack_from(body))
