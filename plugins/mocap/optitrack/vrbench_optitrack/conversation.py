"""The conversation with Motive, without sockets: what to send when, and what answers mean.

Greet until SERVERINFO comes; ask for bitstream, unit and model definitions, one at a time, for
answers to commands have no tag; then stream. A change bit, a frame that isn't of the version, or
silence begin it anew.
"""

from __future__ import annotations

import struct
from collections import deque
from typing import NamedTuple

import numpy as np

from vrbench.errors import DeviceError, VrbenchError
from vrbench.trajectory import NS
from vrbench_optitrack.bodies import decode_bodies
from vrbench_optitrack.clock import Echo, TickClock
from vrbench_optitrack.frame import BITSTREAM_CHANGED, MODELS_CHANGED
from vrbench_optitrack.handshake import (
    Greeting,
    ServerInfo,
    decode_echo_response,
    decode_number,
    decode_serverinfo,
    decode_words,
    encode_echo_request,
    encode_greeting,
    encode_request,
)
from vrbench_optitrack.models import BodyModel, Model, bodies_of, decode_models
from vrbench_optitrack.options import Options
from vrbench_optitrack.rows import Rows
from vrbench_optitrack.wire import (
    HEADER,
    NEWEST,
    OLDEST,
    Message,
    NatNetError,
    Version,
    message_of,
    packed,
    version_text,
)

Address = tuple[str, int]
RETRY_NS = NS // 2
ECHOES = 60_000
MODEL_TYPES = struct.pack("<i", 0x03)
"""Marker sets and bodies: a Motive 3.1 in the field answered none but requests that say so."""
TRIES = 3
KEEPALIVE_NS = NS
QUICK_ECHO_NS = NS // 10
SILENT_NS = NS
GREETING = encode_greeting(Greeting("vrbench", (0, 1, 0, 0), (*NEWEST, 0, 0)))


class Told(NamedTuple):
    """Something that happened, for the take."""

    t: int
    kind: str
    detail: dict[str, object]


class Conversation:
    """What was said, and what it means.

    Attributes:
        server: SERVERINFO; None before it came.
        version: the bitstream's; None before it is settled.
        unit_mm: of lengths in the stream [mm].
        rate_hz: frames a second as the server says; None where it doesn't.
        models: model definitions; None before they came.
        clock: of the server, another after each step of it; None before NatNet 3.
        rows: frames that wait to be read.
        echoes: answered clock requests.
        told: what happened.
        packets: frames that came, readable or not.
        unreadable: why the newest unreadable frame is so; None after a readable one.
        strangers: packets dropped, for another sender's.
        newest: the newest readable frame, whole.
    """

    def __init__(self, options: Options, server: str) -> None:
        self._options, self.address = options, (server, options.command_port)
        self.server: ServerInfo | None = None
        self.version: Version | None = None
        self.unit_mm = 1000.0
        self.rate_hz: float | None = None
        self.models: list[Model] | None = None
        self.clock: TickClock | None = None
        self.rows = Rows()
        self.echoes: deque[Echo] = deque(maxlen=ECHOES)
        self.told: deque[Told] = deque(maxlen=1000)
        self.packets = self.strangers = 0
        self.unreadable: str | None = None
        self.newest = b""
        self.multicast = options.connection == "multicast"
        self._body_id: int | None = None
        self._sender: Address | None = None
        self._packet_at = self._unreadable_since = self._greeting_since = 0
        self._wants_greeting = True
        self._awaits_server = False
        self._next_greeting = self._next_keepalive = self._next_echo = 0
        self._echoes_sent: dict[int, int] = {}
        self._questions: deque[str] = deque()
        self._asked: str | None = None
        self._asked_at = self._tries = 0
        self._next_models = self._models_asked = 0
        self._want_models = False

    @property
    def body(self) -> BodyModel | None:
        """The wanted body's definition; None where Motive has none of that name."""
        found = [b for b in bodies_of(self.models or []) if b.name == self._options.body]
        return found[0] if found else None

    @property
    def settled(self) -> bool:
        """Whether version, unit and names are known."""
        return self.version is not None and self.models is not None and not self._questions

    def failure(self, now: int) -> VrbenchError | None:
        """Why it makes no sense to go on."""
        silence = self._options.silence_s * NS
        if self.server is not None and self.server.version < OLDEST:
            return DeviceError(
                f"Motive speaks NatNet {version_text(self.server.version)}",
                fix="2.5 or later can be read: Motive 1.5 and on",
            )
        if self._wants_greeting and self.server and now - self._greeting_since > silence:
            return DeviceError(
                f"Motive at {self.address[0]} no longer answers", fix="is it still running?"
            )
        if self.unreadable and now - self._unreadable_since > silence:
            return DeviceError(
                f"frames aren't of NatNet {version_text(self.version or (0, 0))}: "
                f"{self.unreadable}",
                fix="Motive's streaming settings: the bitstream version must be the one it says",
            )
        if self._packet_at and now - self._packet_at > silence:
            return DeviceError(
                f"Motive has sent no frame for {(now - self._packet_at) / NS:.1f} s",
                fix="is it still in Live mode, and the network up?",
            )
        return None

    def outgoing(self, now: int) -> list[bytes]:
        """What to send to the server now."""
        out: list[bytes] = []
        silent = self._packet_at and now - self._packet_at > SILENT_NS
        if (self._wants_greeting or silent) and now >= self._next_greeting:
            out.append(self._greeting())
            self._awaits_server = True
            self._next_greeting = now + RETRY_NS
        if self.server is None:
            return out
        if self.way != "multicast" and now >= self._next_keepalive:
            out.append(packed(Message.KEEPALIVE))
            self._next_keepalive = now + KEEPALIVE_NS
        out += self._question(now)
        if self._want_models and not self._questions and now >= self._next_models:
            types = MODEL_TYPES if self._models_asked % 2 else b""
            out.append(packed(Message.REQUEST_MODELDEF, types))
            self._models_asked += 1
            self._next_models = now + RETRY_NS
        if self.clock is not None and now >= self._next_echo:
            out.append(encode_echo_request(now))
            self._echoes_sent = {k: t for k, t in self._echoes_sent.items() if now - t < 2 * NS}
            self._echoes_sent[now] = now
            few = len(self.clock.kept()) < 3 and len(self.echoes) < 20
            rate = round(NS / self._options.echo_hz)
            self._next_echo = now + (min(QUICK_ECHO_NS, rate) if few else rate)
        return out

    def _greeting(self) -> bytes:
        wanted = self._options.wanted
        if wanted is None:
            return GREETING
        asked = Greeting("vrbench", (0, 1, 0, 0), (*NEWEST, 0, 0), False, (*wanted, 0, 0))
        return encode_greeting(asked)

    def _question(self, now: int) -> list[bytes]:
        """The next command, one at a time; one that isn't answered is given up after a while."""
        if self._asked is not None and now - self._asked_at >= RETRY_NS:
            self._asked = None
            self._tries += 1
            if self._tries >= TRIES:
                self._answered(None)
        if self._asked is None and self._questions:
            self._asked, self._asked_at = self._questions[0], now
            return [encode_request(self._asked)]
        return []

    def incoming(self, packet: bytes, sender: Address, now: int) -> None:
        """Takes in a packet that came at a host time [ns]; another sender's is dropped."""
        if sender[0] != self.address[0] or len(packet) < HEADER.size:
            self.strangers += 1
            return
        if HEADER.unpack_from(packet)[0] == Message.FRAME:
            self._frame(packet, sender, now)
            return
        if sender != self.address:
            self.strangers += 1
            return
        try:
            self._answer(packet, now)
        except NatNetError as error:
            self.told.append(Told(now, "unreadable", {"reason": str(error)}))

    def _answer(self, packet: bytes, now: int) -> None:
        match message_of(packet):
            case Message.SERVERINFO:
                self._greeted(decode_serverinfo(packet), now)
            case Message.MODELDEF if self.version is not None:
                self._defined(decode_models(packet, self.version), now)
            case Message.ECHO_RESPONSE:
                stamp, ticks = decode_echo_response(packet)
                if self._echoes_sent.pop(stamp, None) is not None and ticks < 2**63:
                    self._echoed((stamp, ticks, now), now)
            case Message.RESPONSE if self._asked is not None:
                self._answered(packet)
            case Message.UNRECOGNIZED if self._asked is not None:
                self._answered(None)
            case Message.DISCONNECT_BY_TIMEOUT:
                self._begin_anew(now)

    def _begin_anew(self, now: int) -> None:
        """A new handshake; until it is through, frames aren't read."""
        if not self._wants_greeting:
            self._wants_greeting, self._greeting_since = True, now
        self.version = None

    def _greeted(self, info: ServerInfo, now: int) -> None:
        if not self._awaits_server:
            return
        self._awaits_server = self._wants_greeting = False
        news = info != self.server
        self.server, self.version = info, info.version
        if self._options.connection == "auto":
            self.multicast = info.multicast is not False
        if info.frequency and (self.clock is None or self.clock.frequency != info.frequency):
            self._clock_anew(info.frequency, now)
        self._questions = deque()
        unicast4 = not self.multicast and info.version >= (4, 0)
        wanted = self._options.wanted or (NEWEST if info.version > NEWEST else None)
        if unicast4 and wanted:
            self._questions.append(f"Bitstream,{version_text(wanted)}")
        if unicast4:
            self._questions.append("Bitstream")
        self._questions += ["UnitsToMillimeters", "FrameRate"]
        self._asked, self._tries = None, 0
        self._want_models, self._next_models, self._models_asked = True, 0, 0
        if news:
            self.told.append(Told(now, "server", self.described()))

    def described(self) -> dict[str, object]:
        """The server, in JSON's types."""
        if self.server is None:
            return {}
        return {
            "address": self.address[0],
            "application": self.server.application,
            "application_version": version_text(self.server.application_version),
            "natnet": version_text(self.version or self.server.version),
            "frequency_hz": self.server.frequency,
            "way": self.way,
        }

    @property
    def way(self) -> str:
        """`unicast` or `multicast`; before NatNet 3 a server doesn't say, and both are heard."""
        unsaid = self.server is not None and self.server.multicast is None
        if unsaid and self._options.connection == "auto":
            return "unicast or multicast"
        return "multicast" if self.multicast else "unicast"

    def _answered(self, packet: bytes | None) -> None:
        """The answer to the question asked, or None for none."""
        question = self._questions.popleft() if self._questions else ""
        self._asked, self._tries = None, 0
        if packet is None:
            return
        if question == "Bitstream":
            name, _, value = decode_words(packet).partition(",")
            parts = value.split(".")
            if name == "Bitstream" and len(parts) >= 2 and all(p.isdecimal() for p in parts[:2]):
                self.version = int(parts[0]), int(parts[1])
        elif question == "UnitsToMillimeters":
            unit = decode_number(packet)
            if 0 < unit < 1e6:
                self.unit_mm = unit
        elif question == "FrameRate":
            rate = decode_number(packet)
            self.rate_hz = rate if 0 < rate < 1e6 else None

    def _defined(self, models: list[Model], now: int) -> None:
        news = models != self.models
        self.models, self._want_models = models, False
        body = self.body
        if not news:
            return
        self._body_id = None if body is None else body.id
        detail: dict[str, object] = {"names": [b.name for b in bodies_of(models)]}
        self.told.append(Told(now, "models", detail))

    def _echoed(self, echo: Echo, now: int) -> None:
        if self.clock is None:
            return
        self.echoes.append(echo)
        if self.clock.add(echo):
            return
        there = int(self.clock.to_host(np.array([echo[1]]))[0])
        by = (there - (echo[0] + echo[2]) // 2) / NS
        self.told.append(Told(now, "clock-step", {"clock": "optitrack", "by_s": round(by, 6)}))
        self._clock_anew(self.clock.frequency, now).add(echo)

    def _clock_anew(self, frequency: int, now: int) -> TickClock:
        """A clock that nothing is known of; frames since the old one's last answer are in doubt."""
        if self.clock is not None:
            self.rows.doubt(self.clock.heard, now)
        self.clock = TickClock(frequency)
        return self.clock

    def _frame(self, packet: bytes, sender: Address, now: int) -> None:
        if sender != self._sender:
            # One socket sends the frames; another may only where the first has fallen silent.
            if self._sender is not None and now - self._packet_at < SILENT_NS:
                self.strangers += 1
                return
            self._sender = sender
        self._packet_at = now
        self.packets += 1
        if self.version is None or self._questions:
            return
        try:
            frame = decode_bodies(packet, self.version)
        except NatNetError as error:
            if self.unreadable is None:
                self._unreadable_since = now
                self.told.append(Told(now, "unreadable", {"reason": str(error)}))
            self.unreadable = str(error)
            self._begin_anew(now)
            return
        self.unreadable = None
        self.newest = packet
        params = frame.suffix.params
        if params & BITSTREAM_CHANGED and now >= self._next_greeting:
            self._begin_anew(now)
        if params & MODELS_CHANGED and not self._want_models and now >= self._next_models:
            self._want_models, self._next_models = True, now
        missing = self.rows.take_in(frame, self._body_id, self.clock, now)
        if missing:
            self.told.append(Told(now, "gap", {"stream": "mocap", "frames": missing}))
