"""The server: one thread that gives the page away and talks with one headset.

Loopback unless asked otherwise; nothing without the token of the address; one client at a time.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import ssl
import threading
from typing import Any, Self

from vrbench.devices.link import Link
from vrbench.devices.ports import HostClock
from vrbench.errors import DeviceError
from vrbench.trajectory import NS
from vrbench_webxr import protocol
from vrbench_webxr.door import Door
from vrbench_webxr.protocol import ProtocolError, message

PING_S = 0.1
# The first few come quicker, so that the clock is known at once.
HURRY_S = 0.02
HURRIED = 10
# A headset that hasn't answered for so long is gone; it may come back.
SILENT_S = 5.0
HELLO_S = 5.0
# Without 0, O, 1, l and I: it may have to be typed on a headset's keyboard.
ALPHABET = "abcdefghjkmnpqrstuvwxyz23456789"
TOKEN_LENGTH = 10

# What strangers send to an open port is told as events, not on the terminal.
LOG = logging.getLogger("vrbench_webxr")
LOG.addHandler(logging.NullHandler())


def new_token() -> str:
    """A secret for the address, short enough to be typed."""
    return "".join(secrets.choice(ALPHABET) for _ in range(TOKEN_LENGTH))


class Server:
    """Serves one headset while it is entered.

    Args:
        link: told of everything that comes in.
        host: the recorder's clock.
        address: to listen at.
        port: to listen at; 0 is any free one, and `port` says which.
        token: the secret part of the address.
        tls: for HTTPS; None is HTTP.
        rate_hz: the frame rate to ask the page for [Hz].

    Attributes:
        port: where it listens.
        hello: how the page introduced itself; None before one has.
        state: what the page last said of itself.
    """

    def __init__(
        self,
        link: Link,
        host: HostClock,
        *,
        address: str,
        port: int,
        token: str,
        tls: ssl.SSLContext | None = None,
        rate_hz: float | None = None,
    ) -> None:
        self.port = port
        self.hello: protocol.Hello | None = None
        self.state: protocol.State | None = None
        self._link, self._host = link, host
        self._address, self._tls, self._rate_hz = address, tls, rate_hz
        self._door = Door(link, host, token, "https" if tls else "http")
        self._take: str | None = None
        self._connection: Any = None
        self._page = ""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._stop: asyncio.Event | None = None

    def __enter__(self) -> Self:
        ready: list[BaseException | None] = []
        begun = threading.Event()

        def run() -> None:
            asyncio.run(self._serve(ready, begun))

        self._thread = threading.Thread(target=run, name="vrbench-webxr", daemon=True)
        self._thread.start()
        begun.wait()
        if ready[0] is not None:
            self._thread.join()
            raise DeviceError(
                f"can't listen at {self._address}:{self.port}: {ready[0]}",
                field="headset.options.listen",
                fix="an address of this PC, and a port that nothing else uses",
            ) from ready[0]
        return self

    def __exit__(self, *error: object) -> None:
        loop, stop, thread = self._loop, self._stop, self._thread
        if loop is not None and stop is not None and thread is not None:
            with contextlib.suppress(RuntimeError):  # it ended by itself
                loop.call_soon_threadsafe(stop.set)
            thread.join()

    @property
    def connected(self) -> bool:
        """Whether a headset is connected now."""
        return self._connection is not None

    def set_take(self, name: str | None) -> None:
        """Tells the page which take is being recorded, or that none is."""
        self._take = name
        self._tell(message("take", name=name))

    def _tell(self, text: str) -> None:
        loop, connection = self._loop, self._connection
        if loop is None or connection is None:
            return
        with contextlib.suppress(RuntimeError):  # the loop has just ended
            asyncio.run_coroutine_threadsafe(_send(connection, text), loop)

    async def _serve(self, ready: list[BaseException | None], begun: threading.Event) -> None:
        from websockets.asyncio.server import serve

        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        try:
            server = await serve(
                self._handle,
                self._address,
                self.port,
                ssl=self._tls,
                process_request=self._door.answer,
                max_size=protocol.MAX_MESSAGE_BYTES,
                max_queue=64,
                compression=None,
                ping_interval=None,  # ours measure the clock as well
                close_timeout=1,
                server_header=None,
                logger=LOG,
            )
        except OSError as error:
            ready.append(error)
            begun.set()
            return
        async with server:
            self.port = next(iter(server.sockets)).getsockname()[1]
            ready.append(None)
            begun.set()
            await self._stop.wait()

    async def _handle(self, connection: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            hello = await asyncio.wait_for(connection.recv(), HELLO_S)
            introduced = protocol.parse_text(hello) if isinstance(hello, str) else None
            if not isinstance(introduced, protocol.Hello):
                raise ProtocolError("the first message is no hello")
        except TimeoutError:
            return await self._close(connection, protocol.BAD_MESSAGE, "no hello came")
        except ProtocolError as error:
            return await self._close(connection, protocol.BAD_MESSAGE, str(error))
        except ConnectionClosed:
            return None
        if introduced.protocol != protocol.VERSION:
            why = f"page of protocol {introduced.protocol}, this is {protocol.VERSION}: reload it"
            return await self._close(connection, protocol.OTHER_VERSION, why)
        if self._connection is not None:
            if introduced.page != self._page:
                why = "another headset is connected"
                return await self._close(connection, protocol.SECOND_CLIENT, why)
            # the same page comes again: it knows better than we that its connection is gone
            old, self._connection = self._connection, None
            why = "this page has connected again"
            self._link.on_closed(self._host.now(), why)
            await _close_quietly(old, protocol.REPLACED, why)
        return await self._talk(connection, introduced)

    async def _talk(self, connection: Any, hello: protocol.Hello) -> None:
        from websockets.exceptions import ConnectionClosed

        self._connection, self._page = connection, hello.page
        self.hello, self.state = hello, None
        expected = self._link.on_hello(
            hello.page,
            round(hello.origin_ms * 1e6),
            hello.model_dump(include={"client", "agent", "isolated"}),
            self._host.now(),
        )
        why = "closed by the headset"
        pings: dict[int, int] = {}
        answered = [self._host.now()]
        welcome = message(
            "welcome",
            protocol=protocol.VERSION,
            next=expected,
            take=self._take,
            rate_hz=self._rate_hz,
        )
        await _send(connection, welcome)
        pinging = asyncio.create_task(self._ping(connection, pings, answered))
        try:
            async for data in connection:
                self._receive(data, pings, answered)
        except ProtocolError as error:
            why = f"refused: {error}"
            await self._close(connection, protocol.BAD_MESSAGE, str(error))
        except ConnectionClosed as error:
            why = str(error)
        finally:
            pinging.cancel()
            if self._connection is connection:
                self._connection = None
                self._link.on_closed(self._host.now(), why)

    def _receive(self, data: str | bytes, pings: dict[int, int], answered: list[int]) -> None:
        now = self._host.now()
        if isinstance(data, bytes):
            batch = protocol.parse_batch(data)
            self._link.on_frames(batch.first, batch.rows, now)
            return
        said = protocol.parse_text(data)
        if isinstance(said, protocol.Pong):
            sent = pings.pop(said.id, None)
            if sent is None:
                raise ProtocolError(f"an answer to ping {said.id}, which was not sent")
            answered[0] = now
            self._link.on_answer(sent, said.received_ms, said.sent_ms, now)
        elif isinstance(said, protocol.State):
            self.state = said
        elif isinstance(said, protocol.PageEvent):
            self._link.on_event(said.id, said.kind, said.now_ms, said.detail, now)
        else:
            raise ProtocolError("a second hello")

    async def _ping(self, connection: Any, pings: dict[int, int], answered: list[int]) -> None:
        """Asks for the time, ten times a second, until the headset stays silent for too long."""
        number = 0
        while True:
            if self._host.now() - answered[0] > SILENT_S * NS:
                why = f"no answer for {SILENT_S:g} s"
                await _close_quietly(connection, protocol.REPLACED, why)
                return
            expected, event = self._link.acknowledged
            text_of = message("ping", id=number, next=expected, event=event)
            pings[number] = self._host.now()
            await _send(connection, text_of)
            number += 1
            await asyncio.sleep(HURRY_S if number < HURRIED else PING_S)

    async def _close(self, connection: Any, code: int, why: str) -> None:
        self._link.on_refused(self._host.now(), why)
        await _close_quietly(connection, code, why)


async def _send(connection: Any, text: str) -> None:
    """Sends, unless the other end has gone; the reading side notices that."""
    from websockets.exceptions import ConnectionClosed

    with contextlib.suppress(ConnectionClosed):
        await connection.send(text)


async def _close_quietly(connection: Any, code: int, why: str) -> None:
    await connection.close(code, why.encode()[:120].decode(errors="ignore"))
