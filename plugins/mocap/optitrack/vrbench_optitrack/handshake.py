"""The short messages of NatNet's handshake: who is there, whose clock says what, commands."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from vrbench_optitrack.wire import (
    HEADER,
    NEWEST,
    Message,
    NatNetError,
    Reader,
    Version,
    message_of,
    name_bytes,
    packed,
    reader_of,
)

_ECHO_REQUEST = struct.Struct("<Q")
_ECHO_RESPONSE = struct.Struct("<QQ")
_SENDER = struct.Struct("<256s4s4s")
_CONNECTION = struct.Struct("<QHB4s")
_OPTIONS = struct.Struct("<B4s")


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
