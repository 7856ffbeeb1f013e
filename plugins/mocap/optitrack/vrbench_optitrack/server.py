"""A Motive to test with: streams a simulated head on loopback, and answers as a server does.

It binds loopback addresses only, and multicast leaves with TTL 0.
"""

from __future__ import annotations

import contextlib
import os
import random
import select
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from vrbench.devices.emulated import EmulatedBody, StageReader
from vrbench.geometry import Floats, Transform
from vrbench_optitrack.behaviour import NS, Faults, ServerClock
from vrbench_optitrack.encode import encode_frame, encode_models
from vrbench_optitrack.frame import BITSTREAM_CHANGED, MODELS_CHANGED, Frame, Suffix
from vrbench_optitrack.handshake import (
    ServerInfo,
    decode_echo_request,
    decode_greeting,
    decode_request,
    encode_echo_response,
    encode_serverinfo,
)
from vrbench_optitrack.scene import Scene
from vrbench_optitrack.wire import (
    MAX_PACKET,
    Message,
    NatNetError,
    Version,
    message_of,
    name_bytes,
    packed,
    version_text,
)

Address = tuple[str, int]
GREET_NS = NS // 5
"""A new client asks for models first; some can't take a frame for their answer."""
QUIET_NS = NS
"""A client that says nothing for so long may be one that only listens at the data port."""
MOTIVE = {2: (1, 10, 0, 0), 3: (2, 3, 0, 0), 4: (3, 1, 0, 0)}


@dataclass(slots=True)
class Client:
    """A unicast client.

    Attributes:
        seen_ns: when it was last heard of.
        version: its bitstream.
        fed_ns: when its first frame is due.
        tried: whether somebody was looked for at the data port.
    """

    seen_ns: int
    version: Version
    fed_ns: int
    tried: bool = False


@dataclass(slots=True)
class Server:
    """A Motive.

    Attributes:
        scene: what is seen.
        version: of its NatNet.
        multicast: to a group; else to each client.
        host: loopback address it binds.
        command_port: 0 takes a free one.
        data_port: of multicast frames; 0 takes the command port's successor.
        group: of multicast frames.
        clock: its clock.
        latency_s: from mid-exposure to sending [s].
        jitter_s: rms of what comes on top [s].
        timeout_s: a client that is silent for so long is forgotten [s].
        faults: what goes wrong.
        seed: of all chance.
    """

    scene: Scene
    version: Version
    multicast: bool
    host: str
    command_port: int
    data_port: int
    group: str
    clock: ServerClock
    latency_s: float
    jitter_s: float
    timeout_s: float
    faults: Faults
    seed: int
    _clients: dict[Address, Client] = field(default_factory=dict)
    _listeners: dict[socket.socket, Version] = field(default_factory=dict)
    _sockets: list[socket.socket] = field(default_factory=list)
    _first_ns: int = 0
    _newest: Frame | None = None
    _params: int = 0
    _params_left: int = 0

    def open(self) -> None:
        """Binds the ports."""
        command = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sockets.append(command)
        command.bind((self.host, self.command_port))
        self.command_port = command.getsockname()[1]
        self.data_port = self.data_port or self.command_port + 1
        data = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sockets.append(data)
        data.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(self.host))
        data.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        data.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        data.bind((self.host, 0))
        # Broadcasts of discovery come in where loopback has them (Linux); elsewhere there are none.
        broadcast = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        broadcast.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            broadcast.bind(("127.255.255.255", self.command_port))
        except OSError:
            broadcast.close()
        else:
            self._sockets.append(broadcast)

    def ride_on(self, stage: Path) -> None:
        """The body is what an emulated robot carries."""
        body = EmulatedBody(StageReader(stage), self.seed)
        # late frames are for those who ask for them
        with contextlib.suppress(OSError):
            os.nice(-10)

        def carried(seconds: Floats) -> Transform:
            return body.pose(self._first_ns + np.rint(seconds * NS).astype(np.int64))

        self.scene = replace(self.scene, carried=carried)

    def close(self) -> None:
        """Releases the ports."""
        for each in [*self._sockets, *self._listeners]:
            each.close()

    def describe(self) -> dict[str, Any]:
        """Ports and the truth of the clock, in JSON's types."""
        return {
            "command_port": self.command_port,
            "data_port": self.data_port,
            "version": version_text(self.version),
            "first_frame_ns": self._first_ns,
            "clock": {
                "frequency": self.clock.frequency,
                "skew_ppm": self.clock.skew_ppm,
                "reference_ns": self.clock.reference_ns,
                "ticks": self.clock.ticks,
            },
        }

    def run(self, duration_s: float | None, begun: Callable[[], None]) -> None:
        """Streams and answers, for so long or until interrupted; `begun` is called at the start."""
        rng = random.Random(self.seed)
        # the motion is computed before time begins to count
        self.scene.frame(0, self.version, Suffix(*[0] * 10), 0)
        self._first_ns = time.monotonic_ns()
        begun()
        period = NS / self.scene.rate_hz
        index = 0
        while duration_s is None or index < duration_s * self.scene.rate_hz:
            mid = self._first_ns + round(index * period)
            due = mid + round((self.latency_s + abs(rng.gauss(0.0, self.jitter_s))) * NS)
            dropped = rng.random() < self.faults.drop
            self._answer_until(due)
            self._events(index)
            if not (dropped or self.faults.mute):
                self._send(index, mid)
            index += 1
            if self.scene.carried is not None:
                # where a robot was half a second ago is forgotten soon: frames are left out instead
                late = time.monotonic_ns() - due - NS // 2
                index += max(0, round(late / period))

    def _answer_until(self, due: int) -> None:
        """Answers what comes in until it is time for the next frame."""
        listening = [self._sockets[0], *self._sockets[2:]]
        while True:
            left = (due - time.monotonic_ns()) / NS
            ready, _, _ = select.select(listening, [], [], max(0, left))
            for each in ready:
                packet, sender = each.recvfrom(MAX_PACKET)
                came = time.monotonic_ns()
                try:
                    self._answer(packet, sender, came)
                except NatNetError:
                    self._reply(sender, packed(Message.UNRECOGNIZED))
            if left <= 0:
                return

    def _events(self, index: int) -> None:
        """What changes in the midst of streaming."""
        since = index / self.scene.rate_hz
        faults = self.faults
        if faults.new_id_after_s is not None and since >= faults.new_id_after_s:
            self.scene = replace(self.scene, id=self.scene.id + 40, _block={})
            self.faults = faults = replace(faults, new_id_after_s=None)
            self._changed(MODELS_CHANGED)
        if faults.switch_after_s is not None and since >= faults.switch_after_s:
            self.version = faults.switch_to or self.version
            for client in self._clients.values():
                client.version = self.version
            self.faults = faults = replace(faults, switch_after_s=None, claim=None)
            self._changed(BITSTREAM_CHANGED)
        if faults.step_after_s is not None and since >= faults.step_after_s:
            stepped = self.clock.ticks + round(faults.step_s * self.clock.frequency)
            self.clock = replace(self.clock, ticks=stepped)
            self.faults = replace(faults, step_after_s=None)

    def _changed(self, bit: int) -> None:
        # Motive raises the bit in a few frames, for one may be lost
        self._params, self._params_left = self._params | bit, 5

    def _send(self, index: int, mid: int) -> None:
        now = time.monotonic_ns()
        stamps = {"mid": 3, "received": 2, "transmit": 1, "none": 0}[self.faults.stamps]
        ticks = (
            self.clock.at(mid) if stamps > 2 else 0,
            self.clock.at(mid + round(0.7 * self.latency_s * NS)) if stamps > 1 else 0,
            self.clock.at(now) if stamps > 0 else 0,
        )
        params = self._params if self._params_left else 0
        self._params_left = max(0, self._params_left - 1)
        self._params = self._params if self._params_left else 0
        stamp = index / self.scene.rate_hz
        suffix = Suffix(0, 0, stamp, stamp, *ticks, 0, 0, params)
        if self.version < (3, 0):
            suffix = suffix._replace(mid_exposure=0, data_received=0, transmit=0)
        packets: dict[Version, bytes] = {}

        def packet(version: Version) -> bytes:
            if version not in packets:
                self._newest = self.scene.frame(index, version, suffix, index + 1)
                packets[version] = encode_frame(self._newest, version)
            return packets[version]

        for address, version in self._targets(now):
            try:
                self._sockets[1 if self.multicast else 0].sendto(packet(version), address)
            except OSError:  # a client that is gone
                self._clients.pop(address, None)
        for listener, version in list(self._listeners.items()):
            try:
                listener.send(packet(version))
            except OSError:  # nobody listens there, or no longer
                listener.close()
                del self._listeners[listener]

    def _targets(self, now: int) -> list[tuple[Address, Version]]:
        if self.multicast:
            return [((self.group, self.data_port), self.version)]
        for address, client in list(self._clients.items()):
            if now - client.seen_ns > QUIET_NS and not client.tried:
                client.tried = True
                self._try_data_port(address[0], client.version)
            if now - client.seen_ns > self.timeout_s * NS:
                self._reply(address, packed(Message.DISCONNECT_BY_TIMEOUT))
                del self._clients[address]
        fed = [(a, client) for a, client in self._clients.items() if now >= client.fed_ns]
        return [(address, client.version) for address, client in fed]

    def _try_data_port(self, host: str, version: Version) -> None:
        """Feeds a client that greets from one socket, and listens at another without a word.

        `motioncapture` does so, and closes the first. Nobody listening is noticed at once.
        """
        if any(each.getpeername()[0] == host for each in self._listeners):
            return
        listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        listener.setblocking(False)
        listener.bind((self.host, 0))
        listener.connect((host, self.data_port))
        self._listeners[listener] = version

    def _reply(self, address: Address, packet: bytes) -> None:
        try:
            self._sockets[0].sendto(packet, address)
        except OSError:  # a client that is gone
            self._clients.pop(address, None)

    def _answer(self, packet: bytes, sender: Address, came: int) -> None:
        message = message_of(packet)
        if sender in self._clients:
            self._clients[sender].seen_ns = came
        match message:
            case Message.CONNECT | Message.DISCOVERY:
                greeting = decode_greeting(packet)
                if message == Message.CONNECT:
                    wanted = (greeting.bitstream[0], greeting.bitstream[1])
                    served = (3, 0) <= wanted <= self.version and self.version >= (4, 0)
                    version = wanted if served else self.version
                    known = self._clients.get(sender)
                    fed = known.fed_ns if known else came + GREET_NS
                    self._clients[sender] = Client(came, version, fed)
                self._reply(sender, encode_serverinfo(self._info()))
            case Message.ECHO_REQUEST if self.version >= (3, 0):
                stamp = decode_echo_request(packet)
                self._reply(sender, encode_echo_response(stamp, self.clock.at(came)))
            case Message.REQUEST_MODELDEF:
                version = self._version_of(sender)
                self._reply(sender, encode_models(self.scene.models(version), version))
            case Message.REQUEST_FRAME if self._newest is not None:
                self._reply(sender, encode_frame(self._newest, self._version_of(sender)))
            case Message.REQUEST:
                self._reply(sender, self._command(decode_request(packet), sender))
            case Message.KEEPALIVE:
                pass
            case Message.DISCONNECT:
                self._clients.pop(sender, None)
            case _:
                self._reply(sender, packed(Message.UNRECOGNIZED))

    def _version_of(self, sender: Address) -> Version:
        client = self._clients.get(sender)
        return self.version if client is None or self.multicast else client.version

    def _info(self) -> ServerInfo:
        version = (*(self.faults.claim or self.version), 0, 0)
        return ServerInfo(
            "Motive",
            MOTIVE[version[0]],
            version,
            self.clock.frequency,
            self.data_port,
            self.multicast,
            self.group,
        )

    def _command(self, command: str, sender: Address) -> bytes:
        """The answer to a command in words."""
        name, _, value = command.partition(",")
        unicast4 = not self.multicast and self.version >= (4, 0)
        match name:
            case "FrameRate":
                return packed(Message.RESPONSE, struct.pack("<f", self.scene.rate_hz))
            case "UnitsToMillimeters":
                return packed(Message.RESPONSE, struct.pack("<f", self.scene.unit_mm))
            case "Bitstream" if unicast4 and not value:
                said = f"Bitstream,{version_text(self._version_of(sender))}"
                return packed(Message.RESPONSE, name_bytes(said))
            case "Bitstream" if unicast4 and sender in self._clients:
                wanted = parse_version(value)
                if wanted is None or not (3, 0) <= wanted <= self.version:
                    return packed(Message.RESPONSE, struct.pack("<i", 1))
                self._clients[sender].version = wanted
                return packed(Message.RESPONSE, struct.pack("<i", 0))
        return packed(Message.UNRECOGNIZED)


def parse_version(text: str) -> Version | None:
    """`4.1` as a pair; None where it is none."""
    major, _, minor = text.partition(".")
    if not (major.isdecimal() and minor.isdecimal()):
        return None
    return int(major), int(minor)
