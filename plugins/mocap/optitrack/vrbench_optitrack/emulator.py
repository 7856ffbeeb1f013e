"""A Motive to test with: streams a simulated head on loopback, and answers as a server does.

    python -m vrbench_optitrack.emulator --version 4.1 --rate 240

Its first line on stdout is JSON: ports, and the truth of its clock, so that a test can tell how
well a client maps it. It binds loopback addresses only, and multicast leaves with TTL 0.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import select
import socket
import struct
import sys
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from vrbench.devices.emulated import EmulatedBody, StageReader
from vrbench.geometry import Floats, Transform
from vrbench_optitrack.encode import encode_frame, encode_models
from vrbench_optitrack.frames import BITSTREAM_CHANGED, MODELS_CHANGED, Frame, Suffix
from vrbench_optitrack.scene import Scene
from vrbench_optitrack.wire import (
    COMMAND_PORT,
    DATA_PORT,
    GROUP,
    MAX_PACKET,
    Message,
    NatNetError,
    ServerInfo,
    Version,
    decode_echo_request,
    decode_greeting,
    decode_request,
    encode_echo_response,
    encode_serverinfo,
    message_of,
    name_bytes,
    packed,
    version_text,
)

NS = 1_000_000_000
Address = tuple[str, int]
MOTIVE = {2: (1, 10, 0, 0), 3: (2, 3, 0, 0), 4: (3, 1, 0, 0)}


@dataclass(frozen=True, slots=True)
class ServerClock:
    """The server's clock, as ticks of the host's monotonic clock.

    Attributes:
        frequency: ticks a second by its own reckoning [Hz].
        skew_ppm: how much it gains on the host's.
        reference_ns: the host's monotonic time at which it shows `ticks`.
        ticks: what it shows then.
    """

    frequency: int
    skew_ppm: float
    reference_ns: int
    ticks: int

    def at(self, monotonic_ns: int) -> int:
        """What it shows at a monotonic time [ns]."""
        since = (monotonic_ns - self.reference_ns) * (1.0 + self.skew_ppm * 1e-6)
        return self.ticks + round(since * self.frequency / NS)


@dataclass(frozen=True, slots=True)
class Faults:
    """What goes wrong.

    Attributes:
        drop: chance that a frame never leaves.
        mute: answers, but sends no frames (Broadcast Frame Data off).
        stamps: which stamps frames carry: `mid`, `received`, `transmit` (and those after), `none`.
        claim: the version SERVERINFO says, where another is streamed.
        new_id_after_s: the body gets another streaming id, and the model list changes.
        switch_after_s: the bitstream changes to `switch_to`.
        switch_to: the version it changes to.
    """

    drop: float = 0.0
    mute: bool = False
    stamps: str = "mid"
    claim: Version | None = None
    new_id_after_s: float | None = None
    switch_after_s: float | None = None
    switch_to: Version | None = None


@dataclass(slots=True)
class Client:
    """A unicast client: when it was last heard of, and its bitstream."""

    seen_ns: int
    version: Version


@dataclass(slots=True)
class Emulator:
    """A server.

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
    _sockets: list[socket.socket] = field(default_factory=list)
    _first_ns: int = 0
    _newest: Frame | None = None
    _params: int = 0
    _params_left: int = 0

    def open(self) -> None:
        """Binds the ports."""
        if not self.host.startswith("127."):
            raise click.UsageError(f"{self.host} isn't a loopback address: 127.0.0.1")
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
        for each in self._sockets:
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

    def run(self, duration_s: float | None) -> None:
        """Streams and answers, for so long or until interrupted."""
        rng = random.Random(self.seed)
        # the motion is computed before time begins to count
        self.scene.frame(0, self.version, Suffix(*[0] * 10), 0)
        self._first_ns = time.monotonic_ns()
        print(json.dumps(self.describe()), flush=True)  # noqa: T201
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
            self.faults = replace(faults, switch_after_s=None, claim=None)
            self._changed(BITSTREAM_CHANGED)

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
        for address, version in self._targets(now):
            if version not in packets:
                self._newest = self.scene.frame(index, version, suffix, index + 1)
                packets[version] = encode_frame(self._newest, version)
            try:
                self._sockets[1 if self.multicast else 0].sendto(packets[version], address)
            except OSError:  # a client that is gone
                self._clients.pop(address, None)

    def _targets(self, now: int) -> list[tuple[Address, Version]]:
        if self.multicast:
            return [((self.group, self.data_port), self.version)]
        for address, client in list(self._clients.items()):
            if now - client.seen_ns > self.timeout_s * NS:
                self._reply(address, packed(Message.DISCONNECT_BY_TIMEOUT))
                del self._clients[address]
        return [(address, client.version) for address, client in self._clients.items()]

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
                    known = (3, 0) <= wanted <= self.version and self.version >= (4, 0)
                    version = wanted if known else self.version
                    self._clients[sender] = Client(came, version)
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


def version(text: str) -> Version:
    """The version that an option names."""
    found = parse_version(text)
    if found is None or not (2, 5) <= found <= (4, 9):
        raise click.BadParameter(f"{text!r} isn't a version of NatNet, as 2.9 or 4.2")
    return found


@click.command(context_settings={"show_default": True})
@click.option("--version", type=version, default="4.1", help="Of NatNet, 2.9 to 4.2.")
@click.option("--rate", default=240.0, type=click.FloatRange(1, 2000), help="Frames a second.")
@click.option("--multicast/--unicast", default=False, help="To a group, or to each client.")
@click.option("--host", default="127.0.0.1", help="Loopback address to bind.")
@click.option("--command-port", default=COMMAND_PORT, help="0 takes a free one.")
@click.option("--data-port", default=DATA_PORT, help="0 takes the command port's successor.")
@click.option("--group", default=GROUP, help="Multicast address.")
@click.option("--motion", default="shooter-1", help="Of the head: the name of a generator.")
@click.option(
    "--stage", type=click.Path(path_type=Path), help="An emulated robot's file: it moves the head."
)
@click.option("--begin", default=0.0, help="Where in the motion to begin [s].")
@click.option("--body", default="headset", help="Name of the head's rigid body.")
@click.option("--markers", default=3, help="Further labeled markers.")
@click.option("--up", type=click.Choice(["y", "z"]), default="y", help="Axis that is up.")
@click.option("--unit-mm", default=1000.0, help="Unit of lengths in the stream [mm].")
@click.option("--frequency", default=10_000_000, help="Ticks a second of the server's clock.")
@click.option("--skew-ppm", default=0.0, help="How much that clock gains.")
@click.option("--clock-offset-s", default=1234.5, help="What it shows at the start [s].")
@click.option("--latency-ms", default=6.25, help="From mid-exposure to sending.")
@click.option("--jitter-ms", default=0.0, help="On top of that, rms.")
@click.option("--drop", default=0.0, type=click.FloatRange(0, 1), help="Part of frames dropped.")
@click.option("--lose-every", default=0.0, help="Tracking is lost once in so many seconds.")
@click.option("--lose-for", default=0.5, help="For so many seconds.")
@click.option("--lost-as", type=click.Choice(["flag", "absent"]), default="flag")
@click.option("--mute", is_flag=True, help="Answers, but sends no frames.")
@click.option(
    "--stamps",
    type=click.Choice(["mid", "received", "transmit", "none"]),
    default="mid",
    help="The first stamp that frames carry.",
)
@click.option("--claim", type=version, help="Version that SERVERINFO says, if another.")
@click.option("--new-id-after", type=float, help="Seconds until the body's id changes.")
@click.option("--switch-after", type=float, help="Seconds until the bitstream changes.")
@click.option("--switch-to", type=version, help="The version it changes to.")
@click.option("--timeout", default=5.0, help="Seconds until a silent client is forgotten.")
@click.option("--seed", default=1, help="Of all chance.")
@click.option("--duration", type=float, help="Ends after so many seconds.")
def main(**given: Any) -> None:
    """Stream a simulated head on loopback as Motive does, until interrupted."""
    emulator = Emulator(
        scene=Scene(
            motion=given["motion"],
            begin_s=given["begin"],
            body=given["body"],
            markers=given["markers"],
            rate_hz=given["rate"],
            up=given["up"],
            unit_mm=given["unit_mm"],
            lose_every_s=given["lose_every"],
            lose_s=given["lose_for"],
            lost_as=given["lost_as"],
        ),
        version=given["version"],
        multicast=given["multicast"],
        host=given["host"],
        command_port=given["command_port"],
        data_port=given["data_port"],
        group=given["group"],
        clock=ServerClock(
            given["frequency"],
            given["skew_ppm"],
            time.monotonic_ns(),
            round(given["clock_offset_s"] * given["frequency"]),
        ),
        latency_s=given["latency_ms"] * 1e-3,
        jitter_s=given["jitter_ms"] * 1e-3,
        timeout_s=given["timeout"],
        faults=Faults(
            drop=given["drop"],
            mute=given["mute"],
            stamps=given["stamps"],
            claim=given["claim"],
            new_id_after_s=given["new_id_after"],
            switch_after_s=given["switch_after"],
            switch_to=given["switch_to"],
        ),
        seed=given["seed"],
    )
    if given["stage"] is not None:
        emulator.ride_on(given["stage"])
    try:
        emulator.open()
        emulator.run(given["duration"])
    except KeyboardInterrupt:
        pass
    except OSError as error:
        sys.exit(f"port {emulator.command_port} of {emulator.host}: {error.strerror}")
    finally:
        emulator.close()


if __name__ == "__main__":
    main()
