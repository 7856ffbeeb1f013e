"""NatNet on the wire: message ids, versions, and how a packet is framed and read.

All is little-endian and packed, one message a UDP datagram: `u16 message, u16 bytes`, then so many
bytes. Sizes are checked before anything is read, so a count can't ask for more than is there.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
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
