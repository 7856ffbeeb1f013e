"""The thread that talks with Motive: sockets below, the conversation above."""

from __future__ import annotations

import threading
from typing import Self

from vrbench.devices.ports import HostClock
from vrbench.errors import DeviceError, VrbenchError
from vrbench_optitrack.conversation import Conversation
from vrbench_optitrack.link import Link, discover, resolved
from vrbench_optitrack.options import Options
from vrbench_optitrack.wire import DATA_PORT, GROUP, Message, packed

TICK_S = 0.02


class Listener:
    """Entered, it talks with the server in a thread of its own.

    Attributes:
        talk: the conversation; hold `lock` to look into it.
        lock: guards `talk`.
        failure: what ended the thread; None while it runs.
    """

    def __init__(self, options: Options, host: HostClock) -> None:
        self._options, self._host = options, host
        self.lock = threading.Lock()
        self.failure: VrbenchError | None = None
        self._stop = threading.Event()
        self.talk: Conversation
        self._link: Link
        self._thread: threading.Thread

    @property
    def interface(self) -> str:
        """Address of the local card."""
        return self._link.interface

    def __enter__(self) -> Self:
        server = resolved(self._options.server) if self._options.server else self._found()
        self.talk = Conversation(self._options, server)
        self._link = Link(self.talk.address, self._options.interface)
        self._thread = threading.Thread(target=self._run, name="optitrack", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._thread.join()
        self._link.close()

    def _found(self) -> str:
        """The one server that answers a broadcast."""
        port = self._options.command_port
        found = discover(self._options.interface, port, self._host)
        if len(found) == 1:
            return found[0][0]
        if not found:
            raise DeviceError(
                "no Motive answers a broadcast",
                field="mocap.options.server",
                fix="give its address; is the firewall of its computer open for UDP 1510, 1511?",
            )
        raise DeviceError(
            f"several answer: {', '.join(address for address, _ in found)}",
            field="mocap.options.server",
            fix="name one of them",
        )

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                self._turn()
            self._link.send(packed(Message.DISCONNECT))
        except VrbenchError as error:
            self.failure = error
        except Exception as error:  # told to whoever reads, not to a log nobody sees
            self.failure = DeviceError(f"the receiving thread failed: {error!r}")

    def _turn(self) -> None:
        """Sends what is due, and takes in what has come."""
        with self.lock:
            due = self.talk.outgoing(self._host.now())
            self._tune_in()
        for packet in due:
            self._link.send(packet)
        for packet, sender, now in self._link.receive(TICK_S, self._host):
            with self.lock:
                self.talk.incoming(packet, sender, now)

    def _tune_in(self) -> None:
        """Listens where the server says it sends."""
        talk, options = self.talk, self._options
        if talk.server is None:
            return
        port = options.data_port or talk.server.data_port or DATA_PORT
        group = options.group or (talk.server.group if talk.server.multicast else "") or GROUP
        self._link.listen(group if talk.multicast else None, port, own=talk.way != "multicast")
