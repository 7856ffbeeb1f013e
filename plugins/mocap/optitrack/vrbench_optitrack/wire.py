"""NatNet on the wire: message ids, the header, and the short messages of the handshake.

All is little-endian and packed, one message a UDP datagram: `u16 message, u16 bytes`, then so many
bytes. Sizes are checked before anything is read, so a count can't ask for more than is there.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from vrbench.errors import DeviceError

COMMAND_PORT = 1510
DATA_PORT = 1511
GROUP = "239.255.42.99"
MAX_PACKET = 65_507

Version = tuple[int, int]
OLDEST: Version = (2, 5)
NEWEST: Version = (4, 2)
"""The newest version whose every field is known; later ones are read by their sections' sizes."""


class Message(IntEnum):
    """Ids of messages."""

    CONNECT = 0
    SERVERINFO = 1
    REQUEST = 2
    RESPONSE = 3
    REQUEST_MODELDEF = 4
    MODELDEF = 5
    REQUEST_FRAME = 6
    FRAME = 7
    MESSAGE_STRING = 8
    DISCONNECT = 9
    KEEPALIVE = 10
    DISCONNECT_BY_TIMEOUT = 11
    ECHO_REQUEST = 12
    ECHO_RESPONSE = 13
    DISCOVERY = 14
    UNRECOGNIZED = 100


class NatNetError(DeviceError):
    """A packet isn't what its version says.

    Attributes:
        offset: where in the packet, in bytes from its start.
        reason: what was found there.
    """

    def __init__(self, offset: int, reason: str) -> None:
        self.offset, self.reason = offset, reason
        super().__init__(f"NatNet packet, byte {offset}: {reason}")

    def __reduce__(self) -> tuple[object, ...]:
        return NatNetError, (self.offset, self.reason)


HEADER = struct.Struct("<HH")
INT = struct.Struct("<i")
PAIR = struct.Struct("<ii")
VECTOR = struct.Struct("<3f")
_ECHO_REQUEST = struct.Struct("<Q")
_ECHO_RESPONSE = struct.Struct("<QQ")
_SENDER = struct.Struct("<256s4s4s")
_CONNECTION = struct.Struct("<QHB4s")
_OPTIONS = struct.Struct("<B4s")


class Reader:
    """Walks through a packet; never past `end`.

    Attributes:
        data: the whole packet.
        at: where the next field begins.
        end: where reading must stop.
    """

    __slots__ = ("at", "data", "end")

    def __init__(self, data: bytes, at: int, end: int) -> None:
        self.data, self.at, self.end = data, at, end

    def unpack(self, layout: struct.Struct, what: str) -> tuple[Any, ...]:
        """The fields of one struct."""
        if layout.size > self.end - self.at:
            raise NatNetError(self.at, f"{what} needs {layout.size} bytes, {self.left} are left")
        values = layout.unpack_from(self.data, self.at)
        self.at += layout.size
        return values

    def integer(self, what: str) -> int:
        """An i32."""
        (value,) = self.unpack(INT, what)
        return value

    def count(self, least: int, what: str) -> int:
        """An i32 that counts things of at least so many bytes each, all still to come."""
        start = self.at
        count = self.integer(f"the number of {what}")
        if count < 0 or count * least > self.left:
            raise NatNetError(start, f"{count} {what} can't be in the {self.left} bytes left")
        return count

    def skip(self, size: int, what: str) -> None:
        """Steps over a count, and as many things of that size."""
        count = self.count(size, what)
        self.at += size * count

    def text(self, what: str) -> str:
        """Text up to its NUL. What isn't UTF-8 is kept as escapes, so names stay distinct."""
        stop = self.data.find(b"\0", self.at, self.end)
        if stop < 0:
            raise NatNetError(self.at, f"{what} has no end")
        text = self.data[self.at : stop].decode(errors="backslashreplace")
        self.at = stop + 1
        return text

    def rows(self, layout: struct.Struct, count: int, what: str) -> list[tuple[Any, ...]]:
        """`count` structs that follow each other."""
        size = layout.size * count
        if count < 0 or size > self.left:
            raise NatNetError(self.at, f"{count} {what} can't be in the {self.left} bytes left")
        rows = list(layout.iter_unpack(self.data[self.at : self.at + size]))
        self.at += size
        return rows

    def finish(self, what: str) -> None:
        """Raises NatNetError unless all has been read."""
        if self.at != self.end:
            raise NatNetError(self.at, f"{self.left} bytes are left over after {what}")

    @property
    def left(self) -> int:
        """How many bytes are still to come."""
        return self.end - self.at


def message_of(packet: bytes) -> int:
    """The packet's message id, its length checked.

    Raises:
        NatNetError: it is shorter or longer than its header says.
    """
    if len(packet) < HEADER.size:
        raise NatNetError(0, f"{len(packet)} bytes are no header")
    message, size = HEADER.unpack_from(packet)
    if size + HEADER.size != len(packet):
        raise NatNetError(2, f"the header promises {size} bytes, {len(packet) - 4} follow")
    return message


def reader_of(packet: bytes, message: Message) -> Reader:
    """A reader behind the header of a packet that must be of this kind.

    Raises:
        NatNetError: another kind, or another length than the header says.
    """
    found = message_of(packet)
    if found != message:
        raise NatNetError(0, f"message {found} is no {message.name} ({message.value})")
    return Reader(packet, HEADER.size, len(packet))


def packed(message: int, payload: bytes = b"") -> bytes:
    """A packet."""
    if len(payload) + HEADER.size > MAX_PACKET:
        raise ValueError(f"{len(payload)} bytes don't fit a datagram")
    return HEADER.pack(message, len(payload)) + payload


def name_bytes(text: str) -> bytes:
    """Text with its NUL."""
    return text.encode() + b"\0"


def version_text(version: Sequence[int]) -> str:
    """`4.1`."""
    return ".".join(map(str, version[:2]))


@dataclass(frozen=True, slots=True)
class ServerInfo:
    """What a server says of itself.

    Attributes:
        application: its name, `Motive`.
        application_version: of the application, four numbers.
        natnet_version: of the protocol, four numbers.
        frequency: ticks a second of its clock [Hz]; 0 before NatNet 3.
        data_port: where frames are sent; 0 before NatNet 3.
        multicast: whether to a group; None before NatNet 3.
        group: the group's address.
    """

    application: str
    application_version: tuple[int, ...]
    natnet_version: tuple[int, ...]
    frequency: int = 0
    data_port: int = 0
    multicast: bool | None = None
    group: str = ""

    @property
    def version(self) -> Version:
        return self.natnet_version[0], self.natnet_version[1]


def decode_serverinfo(packet: bytes) -> ServerInfo:
    """A SERVERINFO: 264 bytes before NatNet 3, 279 since; later ones may be longer.

    Raises:
        NatNetError: it is none, or too short.
    """
    reader = reader_of(packet, Message.SERVERINFO)
    name, application, natnet = reader.unpack(_SENDER, "the sender")
    info = ServerInfo(_name(name), tuple(application), tuple(natnet))
    if info.version < (3, 0):
        if reader.left >= _CONNECTION.size:
            return info
        reader.finish("the sender")
        return info
    frequency, port, multicast, group = reader.unpack(_CONNECTION, "the connection")
    if info.version <= NEWEST:
        reader.finish("the connection")
    return ServerInfo(
        info.application,
        info.application_version,
        info.natnet_version,
        frequency,
        port,
        bool(multicast),
        ".".join(map(str, group)),
    )


def encode_serverinfo(info: ServerInfo) -> bytes:
    """The SERVERINFO packet that says so."""
    payload = _SENDER.pack(
        info.application.encode()[:255], bytes(info.application_version), bytes(info.natnet_version)
    )
    if info.version >= (3, 0):
        group = bytes(int(part) for part in (info.group or "0.0.0.0").split("."))
        payload += _CONNECTION.pack(info.frequency, info.data_port, bool(info.multicast), group)
    return packed(Message.SERVERINFO, payload)


@dataclass(frozen=True, slots=True)
class Greeting:
    """A CONNECT or DISCOVERY.

    Attributes:
        name: of the client.
        version: of the client, four numbers.
        natnet: of the protocol it knows, four numbers.
        subscribed_only: whether it wants only what it subscribes to.
        bitstream: the version it wants frames in; zeros leave it to the server.
    """

    name: str = ""
    version: tuple[int, ...] = (0, 0, 0, 0)
    natnet: tuple[int, ...] = (0, 0, 0, 0)
    subscribed_only: bool = False
    bitstream: tuple[int, ...] = (0, 0, 0, 0)


def decode_greeting(packet: bytes) -> Greeting:
    """A CONNECT or DISCOVERY; what lacks the sender's block, as an empty one does, greets too.

    Raises:
        NatNetError: the packet is neither.
    """
    message = message_of(packet)
    if message not in (Message.CONNECT, Message.DISCOVERY):
        raise NatNetError(0, f"message {message} is no greeting")
    reader = Reader(packet, HEADER.size, len(packet))
    if reader.left < _SENDER.size:
        return Greeting(_name(packet[HEADER.size :]))
    name, version, natnet = reader.unpack(_SENDER, "the sender")
    greeting = Greeting(_name(name), tuple(version), tuple(natnet))
    if reader.left < _OPTIONS.size:
        return greeting
    only, bitstream = reader.unpack(_OPTIONS, "the options")
    return Greeting(greeting.name, greeting.version, greeting.natnet, bool(only), tuple(bitstream))


def encode_greeting(greeting: Greeting, message: Message = Message.CONNECT) -> bytes:
    """The CONNECT or DISCOVERY packet; with the options of NatNet 4 where any is chosen."""
    payload = _SENDER.pack(
        greeting.name.encode()[:255], bytes(greeting.version), bytes(greeting.natnet)
    )
    if greeting.subscribed_only or any(greeting.bitstream):
        payload += _OPTIONS.pack(greeting.subscribed_only, bytes(greeting.bitstream))
    return packed(message, payload)


def encode_echo_request(stamp: int) -> bytes:
    """A request for the server's ticks; `stamp` comes back with them."""
    return packed(Message.ECHO_REQUEST, _ECHO_REQUEST.pack(stamp))


def decode_echo_request(packet: bytes) -> int:
    """The client's stamp."""
    reader = reader_of(packet, Message.ECHO_REQUEST)
    (stamp,) = reader.unpack(_ECHO_REQUEST, "the stamp")
    reader.finish("the stamp")
    return stamp


def encode_echo_response(stamp: int, ticks: int) -> bytes:
    """The answer to an echo request."""
    return packed(Message.ECHO_RESPONSE, _ECHO_RESPONSE.pack(stamp, ticks))


def decode_echo_response(packet: bytes) -> tuple[int, int]:
    """The client's stamp, and the server's ticks when it came in."""
    reader = reader_of(packet, Message.ECHO_RESPONSE)
    stamp, ticks = reader.unpack(_ECHO_RESPONSE, "the stamps")
    reader.finish("the stamps")
    return stamp, ticks


def encode_request(command: str) -> bytes:
    """A command in words, `UnitsToMillimeters`."""
    return packed(Message.REQUEST, name_bytes(command))


def decode_request(packet: bytes) -> str:
    """The words of a command."""
    return _name(packet[reader_of(packet, Message.REQUEST).at :])


def decode_number(packet: bytes) -> float:
    """The answer to a command that asks for a number: an f32.

    Raises:
        NatNetError: it is no RESPONSE of four bytes.
    """
    reader = reader_of(packet, Message.RESPONSE)
    (value,) = reader.unpack(struct.Struct("<f"), "a number")
    reader.finish("a number")
    return value


def decode_words(packet: bytes) -> str:
    """The answer to a command that asks for words."""
    return _name(packet[reader_of(packet, Message.RESPONSE).at :])


def _name(raw: bytes) -> str:
    """Text up to the first NUL: what follows is whatever stood in the sender's memory."""
    return raw.split(b"\0", 1)[0].decode(errors="backslashreplace")
