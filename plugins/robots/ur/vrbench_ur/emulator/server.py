"""The emulator's ports, in one loop of 2 ms ticks: RTDE, script, dashboard, primary."""

from __future__ import annotations

import contextlib
import os
import selectors
import socket
import struct
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from vrbench_ur import rtde
from vrbench_ur.emulator.controller import Controller
from vrbench_ur.emulator.dashboard import GREETING, answer
from vrbench_ur.emulator.twin import TICK_S
from vrbench_ur.primary import kinematics_message

RATE_HZ = round(1 / TICK_S)
# Farther behind than this, the loop gives up on the ticks it has missed [s].
MOST_BEHIND_S = 5.0
KEEP_BYTES = 65536
PORTS = (rtde.PORT_RTDE, rtde.PORT_SCRIPT, rtde.PORT_DASHBOARD, rtde.PORT_PRIMARY)


@dataclass(eq=False, slots=True)
class Client:
    """A connection.

    Attributes:
        port: which of them.
        out: bytes that are still to be sent.
        recipes: input variables by recipe id, with their layout.
        names, layout, every: what it is sent, and every how many ticks; nothing while `every` is 0.
    """

    socket: socket.socket
    port: int
    out: bytearray = field(default_factory=bytearray)
    framing: rtde.Framing = field(default_factory=rtde.Framing)
    text: str = ""
    recipes: dict[int, tuple[list[str], struct.Struct]] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    layout: struct.Struct | None = None
    asked_every: int = 1
    every: int = 0
    dropped: int = 0


class Server:
    """Serves one controller.

    Args:
        controller: what is served.
        host: a loopback address, 127.0.0.1 to 127.255.255.254.
        version: of the controller's software: major, minor, bugfix, build.

    Attributes:
        after_tick: told of every tick, with the monotonic time it was due [s].

    Raises:
        OSError: a port is taken.
    """

    def __init__(
        self, controller: Controller, host: str, version: tuple[int, int, int, int]
    ) -> None:
        self.controller, self.host, self.version = controller, host, version
        self.clients: list[Client] = []
        self.mute = False
        self.taken: set[str] = set()
        self.skip_packets = 0
        self._frozen_until = 0.0
        self._selector = selectors.DefaultSelector()
        self._listeners = []
        for port in PORTS:
            listener = socket.socket()
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((host, port))
            listener.listen(8)
            listener.setblocking(False)
            self._selector.register(listener, selectors.EVENT_READ, port)
            self._listeners.append(listener)
        self._commands: Callable[[str], str | None] | None = None
        self._typed = b""
        self.after_tick: Callable[[float], None] | None = None
        self.until_eof = False
        self.running = True

    def listen_to(self, commands: Callable[[str], str | None]) -> None:
        """Takes commands from standard input, a line each; what they return is printed."""
        with contextlib.suppress(ValueError, OSError, PermissionError):
            os.set_blocking(sys.stdin.fileno(), False)
            self._selector.register(sys.stdin.fileno(), selectors.EVENT_READ, "stdin")
            self._commands = commands

    def freeze(self, seconds: float) -> None:
        """Nothing happens and nothing is answered for so long."""
        self.controller.note(f"freeze {seconds:g}")
        self._frozen_until = time.monotonic() + seconds

    def drop(self) -> None:
        """All connections are cut."""
        self.controller.note("drop")
        for client in list(self.clients):
            self._close(client)

    def run(self) -> None:
        """Serves until it is told to end."""
        due = time.monotonic()
        while self.running:
            now = time.monotonic()
            if now < self._frozen_until:
                time.sleep(min(0.01, self._frozen_until - now))
                due = time.monotonic()
                continue
            for key, _ in self._selector.select(max(0.0, due - now)):
                self._serve(key)
            # what has come in is served between any two ticks, even where many are late
            if time.monotonic() < due:
                continue
            due += TICK_S
            self.controller.tick()
            if self.after_tick is not None:
                self.after_tick(due)
            self._send()
            if time.monotonic() - due > MOST_BEHIND_S:
                due = time.monotonic()
        self.drop()
        for listener in self._listeners:
            listener.close()
        self._selector.close()

    def _serve(self, key: selectors.SelectorKey) -> None:
        if isinstance(key.data, Client):
            self._receive(key.data)
        elif key.data == "stdin":
            self._typed_in()
        elif isinstance(key.fileobj, socket.socket):
            self._accept(key.fileobj, key.data)

    def _accept(self, listener: socket.socket, port: int) -> None:
        try:
            connection, _ = listener.accept()
        except OSError:
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # a small buffer, so that a slow client is noticed and loses whole packets
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KEEP_BYTES)
        client = Client(connection, port)
        self.clients.append(client)
        self._selector.register(connection, selectors.EVENT_READ, client)
        if self.mute:
            return
        if port == rtde.PORT_DASHBOARD:
            self._reply(client, GREETING.encode())
        elif port == rtde.PORT_PRIMARY:
            self._reply(client, kinematics_message(self.controller.twin.arm.dh, True))

    def _close(self, client: Client) -> None:
        if client in self.clients:
            self.clients.remove(client)
            with contextlib.suppress(KeyError, ValueError):
                self._selector.unregister(client.socket)
            client.socket.close()

    def _receive(self, client: Client) -> None:
        try:
            data = client.socket.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._close(client)
        elif self.mute:
            return
        elif client.port == rtde.PORT_RTDE:
            try:
                for kind, payload in client.framing.feed(data):
                    self._message(client, kind, payload)
            except (ValueError, struct.error):
                self._close(client)
        elif client.port != rtde.PORT_PRIMARY:
            client.text += data.decode(errors="replace")
            if client.port == rtde.PORT_SCRIPT:
                self._scripts(client)
            else:
                self._dashboard(client)

    def _scripts(self, client: Client) -> None:
        """Takes whole programs, which end in a line that is exactly `end`."""
        while True:
            lines = client.text.split("\n")
            if "end" not in lines[:-1]:
                return
            at = lines.index("end")
            self.controller.upload("\n".join(lines[: at + 1]))
            client.text = "\n".join(lines[at + 1 :])

    def _dashboard(self, client: Client) -> None:
        *lines, client.text = client.text.split("\n")
        for line in lines:
            text, leave = answer(line.strip(), self.controller, self.version)
            self._reply(client, (text + "\n").encode())
            if leave:
                self._close(client)

    def _message(self, client: Client, kind: int, payload: bytes) -> None:
        if kind == rtde.DATA:
            self._written(client, payload)
        elif kind == rtde.VERSION_REQUEST:
            self._reply(client, rtde.message(kind, b"\x01"))
        elif kind == rtde.CONTROLLER_VERSION:
            self._reply(client, rtde.message(kind, struct.pack(">4I", *self.version)))
        elif kind == rtde.SETUP_OUTPUTS:
            self._set_outputs(client, payload)
        elif kind == rtde.SETUP_INPUTS:
            self._set_inputs(client, payload)
        elif kind in (rtde.START, rtde.PAUSE):
            client.every = client.asked_every if kind == rtde.START and client.layout else 0
            self._reply(client, rtde.message(kind, b"\x01"))

    def _set_outputs(self, client: Client, payload: bytes) -> None:
        (rate,) = struct.unpack_from(">d", payload)
        names = [name for name in payload[8:].decode().split(",") if name]
        kinds = [rtde.OUTPUTS.get(name, "NOT_FOUND") for name in names]
        if "NOT_FOUND" not in kinds:
            client.names, client.layout = names, rtde.layout(kinds)
            client.asked_every = max(1, round(RATE_HZ / rate)) if rate > 0 else 1
        self._reply(client, rtde.message(rtde.SETUP_OUTPUTS, b"\x01" + ",".join(kinds).encode()))

    def _set_inputs(self, client: Client, payload: bytes) -> None:
        names = [name for name in payload.decode().split(",") if name]
        used = self.taken | {
            name
            for other in self.clients
            if other is not client
            for owned, _ in other.recipes.values()
            for name in owned
        }
        kinds = ["IN_USE" if name in used else rtde.INPUTS.get(name, "NOT_FOUND") for name in names]
        recipe = 0
        if not {"IN_USE", "NOT_FOUND"} & set(kinds):
            recipe = len(client.recipes) + 1
            client.recipes[recipe] = (names, rtde.layout(kinds))
        told = bytes([recipe]) + ",".join(kinds).encode()
        self._reply(client, rtde.message(rtde.SETUP_INPUTS, told))

    def _written(self, client: Client, payload: bytes) -> None:
        names, layout = client.recipes.get(payload[0], ([], None))
        # the client's getForwardKinematics(q, tcp) sends more than its recipe holds
        if layout is None or len(payload) - 1 < layout.size:
            raise ValueError("values that no recipe describes")
        for name, value in zip(names, layout.unpack_from(payload, 1), strict=True):
            self.controller.write(name, value)

    def _reply(self, client: Client, data: bytes) -> None:
        client.out += data
        self._flush(client)

    def _flush(self, client: Client) -> None:
        try:
            sent = client.socket.send(client.out)
            del client.out[:sent]
        except BlockingIOError:
            pass
        except OSError:
            self._close(client)

    def _send(self) -> None:
        """The tick's packets; a client that hasn't taken its last one loses this one whole."""
        if self.mute:
            return
        if self.skip_packets > 0:
            self.skip_packets -= 1
            return
        for client in list(self.clients):
            if client.out:
                self._flush(client)
            if not client.every or self.controller.tick_count % client.every or not client.layout:
                continue
            if client.out:
                client.dropped += 1
                continue
            values = self.controller.outputs(client.names)
            packet = rtde.message(rtde.DATA, b"\x01" + client.layout.pack(*values))
            self._reply(client, packet)

    def _typed_in(self) -> None:
        try:
            data = os.read(sys.stdin.fileno(), 4096)
        except BlockingIOError:
            return
        if not data:
            self._selector.unregister(sys.stdin.fileno())
            self.running = self.running and not self.until_eof
            return
        *lines, self._typed = (self._typed + data).split(b"\n")
        for line in lines:
            answered: Any = self._commands(line.decode().strip()) if self._commands else None
            if answered is not None:
                print(answered, flush=True)  # noqa: T201
