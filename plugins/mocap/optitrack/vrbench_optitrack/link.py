"""Sockets to a Motive: one for commands, one for frames; frames may come to either."""

from __future__ import annotations

import select
import socket
import struct
import sys
from collections.abc import Iterator

from vrbench.devices.ports import HostClock
from vrbench.errors import DeviceError
from vrbench_optitrack.handshake import Greeting, ServerInfo, decode_serverinfo, encode_greeting
from vrbench_optitrack.wire import MAX_PACKET, Message, NatNetError

Address = tuple[str, int]
BUFFER_BYTES = 4 << 20
"""Of frames the system holds for us: seconds of them, should this thread be kept waiting."""
BATCH = 256


class Link:
    """Both sockets.

    Attributes:
        interface: address of the local card.

    Raises:
        DeviceError: the local address can't be bound.
    """

    def __init__(self, server: Address, interface: str | None) -> None:
        self._server = server
        self.interface = interface or _route(server)
        self._command = _socket(self.interface, 0)
        self._data: socket.socket | None = None
        self._joined: tuple[str, int] | None = None

    def close(self) -> None:
        """Leaves the group and closes the sockets."""
        for each in (self._command, self._data):
            if each is not None:
                each.close()

    def send(self, packet: bytes) -> None:
        """Sends to the server's command port.

        Raises:
            DeviceError: the network says it can't.
        """
        try:
            self._command.sendto(packet, self._server)
        except OSError as error:
            raise DeviceError(
                f"can't send to {self._server[0]}: {error.strerror}",
                fix="is the network card up, and `interface` in the server's network?",
            ) from error

    def listen(self, group: str | None, port: int, *, own: bool = True) -> None:
        """Listens for frames on a port: of a multicast group, or sent to this host, or both.

        Args:
            group: to be joined; None for none.
            port: of frames.
            own: hear what is sent to this host, too.

        Raises:
            DeviceError: the group can't be joined on this interface.
        """
        if self._joined == (group or "", port):
            return
        if self._data is not None:
            self._data.close()
            self._data = None
        self._joined = (group or "", port)
        try:
            if group is None:
                self._data = _socket(self.interface, port)
            else:
                self._data = _member(group, port, self.interface, own=own)
        except (OSError, DeviceError) as error:
            if group is None:
                return  # another program has the port; frames come to the command socket then
            raise DeviceError(
                f"can't join {group}:{port} on {self.interface}: {error}",
                fix="`interface` is the address of the card that leads to Motive",
            ) from error

    def receive(self, wait_s: float, host: HostClock) -> Iterator[tuple[bytes, Address, int]]:
        """Packets, their senders, and when they came [ns]; waits for the first at most so long."""
        sockets = [self._command] if self._data is None else [self._command, self._data]
        ready, _, _ = select.select(sockets, [], [], wait_s)
        for each in ready:
            for _ in range(BATCH):
                try:
                    packet, sender = each.recvfrom(MAX_PACKET)
                except BlockingIOError:
                    break
                except ConnectionError:  # Windows tells of a port that nobody listens on
                    continue
                yield packet, sender, host.now()


def discover(
    interface: str | None, port: int, host: HostClock, wait_s: float = 1.0
) -> list[tuple[str, ServerInfo]]:
    """Servers that answer a broadcast, by address.

    Raises:
        DeviceError: the local address can't be bound, or the network says it can't.
    """
    here = interface or ""
    asking = _socket(here, 0)
    found: dict[str, ServerInfo] = {}
    try:
        asking.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        everyone = "127.255.255.255" if here.startswith("127.") else "255.255.255.255"
        packet = encode_greeting(Greeting("vrbench", (0, 1, 0, 0), (4, 2, 0, 0)), Message.DISCOVERY)
        asking.sendto(packet, (everyone, port))
        end = host.now() + round(wait_s * 1e9)
        while (left := (end - host.now()) / 1e9) > 0:
            if not select.select([asking], [], [], left)[0]:
                break
            try:
                answer, sender = asking.recvfrom(MAX_PACKET)
                found.setdefault(sender[0], decode_serverinfo(answer))
            except (NatNetError, OSError):
                continue
    except OSError as error:
        raise DeviceError(
            f"can't search for Motive: {error.strerror}", fix="give `server` its address"
        ) from error
    finally:
        asking.close()
    return sorted(found.items())


def resolved(server: str) -> str:
    """The address of a computer that is given by name or address: packets show the address.

    Raises:
        DeviceError: no computer has the name.
    """
    try:
        return socket.gethostbyname(server)
    except OSError as error:
        raise DeviceError(
            f"{server!r} can't be found: {error.strerror or error}",
            field="mocap.options.server",
            fix="the address of Motive's computer",
        ) from error


def _route(server: Address) -> str:
    """The local address that packets to the server leave from."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(server)
        except OSError as error:
            raise DeviceError(
                f"no way to {server[0]}: {error.strerror or error}",
                fix="`server` is Motive's address, `interface` that of the card leading there",
            ) from error
        return str(probe.getsockname()[0])


def _socket(here: str, port: int) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        if port:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        made.setblocking(False)
        made.bind((here, port))
    except OSError as error:
        made.close()
        raise DeviceError(
            f"can't use the local address {here}: {error.strerror}",
            fix="`interface` is the address of a network card of this computer",
        ) from error
    return made


def _member(group: str, port: int, interface: str, *, own: bool) -> socket.socket:
    """A socket that hears a group on one interface; and what is sent to this host."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        made.setblocking(False)
        # Windows binds no group; elsewhere it keeps out what is sent to the port otherwise.
        made.bind(("" if own or sys.platform == "win32" else group, port))
        membership = struct.pack("4s4s", socket.inet_aton(group), socket.inet_aton(interface))
        made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
    except OSError:
        made.close()
        raise
    return made
