"""Runs beside the runtime and sends its poses to a recorder on another PC.

    python -m vrbench_openxr.relay https://192.168.1.5:8765/TOKEN/

It speaks the protocol of vrbench-webxr, in the place of a page; the recorder's rig has
`plugin: webxr`.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import secrets
import ssl
import struct
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from vrbench.errors import ConfigError, DeviceError, VrbenchError
from vrbench_openxr.runtime import Located, Runtime, now_ns
from vrbench_openxr.sampler import Sampler

PROTOCOL = 1
COLUMNS = 18
MAX_ROWS = 4096
# Two minutes at 500 Hz, while the recorder is away.
HELD = 60_000
STATE_S = 1.0
RETRY_S = 1.0
# The recorder asks ten times a second; where it stays silent for so long, the connection is gone.
SILENT_S = 3.0
ROW = struct.Struct(f"<{COLUMNS}d")
HEADER = struct.Struct("<4d")
NAN = float("nan")


class Relay:
    """Holds poses until the recorder has them.

    Args:
        url: the address that the recorder printed.
        tls: how its certificate is checked; None for http.
        say: told what a person should know.
    """

    def __init__(
        self, url: str, tls: ssl.SSLContext | None, say: Callable[[str], None], rate_hz: float
    ) -> None:
        if not url.startswith(("http://", "https://")):
            raise ConfigError(f"{url!r} is no address of a recorder", fix="as it was printed")
        self._url = url.rstrip("/").replace("http", "ws", 1) + "/ws"
        self._tls, self._say, self._rate_hz = tls, say, rate_hz
        self._page = secrets.token_hex(16)
        self._origin_ms = (time.time_ns() - now_ns()) / 1e6
        self._lock = threading.Lock()
        self._held: deque[bytes] = deque()
        self._first = self._sent = self._dropped = 0
        self._events: deque[dict[str, Any]] = deque(maxlen=1000)
        self._event = self._event_sent = 0

    def on_pose(self, located: Located) -> None:
        """Holds a pose; the oldest is given up where there are too many."""
        time_ms, asked_ms = located.time_ns / 1e6, located.asked_ns / 1e6
        velocities = (NAN,) * 6
        row = ROW.pack(
            time_ms, time_ms, asked_ms, *located.pose, *velocities, located.flags, located.epoch
        )
        with self._lock:
            self._held.append(row)
            if len(self._held) > HELD:
                self._held.popleft()
                self._first += 1
                self._dropped += 1

    def on_event(self, kind: str, detail: dict[str, Any]) -> None:
        """Holds an event."""
        with self._lock:
            event = {"id": self._event, "kind": kind, "now_ms": now_ns() / 1e6, "detail": detail}
            self._events.append({"type": "event", **event})
            self._event += 1

    def run(self, sampler: Sampler, going_on: Callable[[], bool]) -> None:
        """Talks with the recorder while the session goes on, and comes back after a break.

        Where the session ends while the recorder is away, what is held is kept for it.

        Raises:
            DeviceError: the recorder refuses.
        """
        from websockets.exceptions import ConnectionClosed, InvalidHandshake
        from websockets.sync.client import connect

        while going_on() and (sampler.running or self._holds()):
            try:
                with connect(
                    self._url, ssl=self._tls, compression=None, proxy=None, open_timeout=5
                ) as socket:
                    self._say("connected")
                    self._talk(socket, sampler, going_on)
            except InvalidHandshake as error:
                raise DeviceError(
                    f"the recorder refuses: {error}", fix="the address as it was printed, anew"
                ) from error
            except ConnectionClosed as error:
                if error.rcvd is not None and error.rcvd.code in (4001, 4002, 4003):
                    raise DeviceError(f"the recorder refuses: {error.rcvd.reason}") from error
                self._say(f"connection lost: {error}")
            except OSError as error:
                self._say(f"no recorder: {error}")
            if going_on():
                time.sleep(RETRY_S)

    def _talk(self, socket: Any, sampler: Sampler, going_on: Callable[[], bool]) -> None:
        facts = sampler.runtime.facts
        agent = " ".join(
            str(facts.get(key, "")) for key in ("system", "runtime", "runtime_version")
        )
        hello = {"protocol": PROTOCOL, "page": self._page, "origin_ms": self._origin_ms}
        told = {"client": "openxr relay", "agent": agent[:500], "isolated": True, "webxr": True}
        socket.send(json.dumps({"type": "hello", **hello, **told}))
        stated, heard = 0.0, time.monotonic()
        while going_on():
            if time.monotonic() - heard > SILENT_S:
                self._say("the recorder is silent")
                return
            if time.monotonic() - stated > STATE_S:
                stated = time.monotonic()
                socket.send(json.dumps(self._state(sampler)))
            with contextlib.suppress(TimeoutError):
                text = socket.recv(timeout=0.1)
                heard = time.monotonic()
                self._answer(socket, json.loads(text), now_ns() / 1e6)
            if not sampler.running and not self._holds():
                return

    def _answer(self, socket: Any, said: dict[str, Any], received_ms: float) -> None:
        if said["type"] == "welcome":
            with self._lock:
                self._acknowledge(said["next"], -1)
                self._sent, self._event_sent = self._first, 0
        elif said["type"] == "take":
            self._say("take ends" if said["name"] is None else f"take {said['name']}")
        elif said["type"] == "ping":
            with self._lock:
                self._acknowledge(said["next"], said["event"])
                batches, events = self._unsent()
            for message in (*batches, *(json.dumps(event) for event in events)):
                socket.send(message)
            times = {"received_ms": received_ms, "sent_ms": now_ns() / 1e6}
            socket.send(json.dumps({"type": "pong", "id": said["id"], **times}))

    def _holds(self) -> bool:
        """Whether there is something that the recorder hasn't got yet."""
        return bool(self._events or self._held)

    def _acknowledge(self, next_frame: int | None, last_event: int) -> None:
        while next_frame is not None and self._first < next_frame and self._held:
            self._held.popleft()
            self._first += 1
        while self._events and self._events[0]["id"] <= last_event:
            self._events.popleft()

    def _unsent(self) -> tuple[list[bytes], list[dict[str, Any]]]:
        """Batches of frames and events that this connection hasn't carried yet."""
        self._sent = max(self._sent, self._first)
        rows = list(self._held)[self._sent - self._first :]
        batches = []
        for at in range(0, len(rows), MAX_ROWS):
            part = rows[at : at + MAX_ROWS]
            head = HEADER.pack(PROTOCOL, self._sent + at, len(part), COLUMNS)
            batches.append(head + b"".join(part))
        self._sent += len(rows)
        events = [event for event in self._events if event["id"] >= self._event_sent]
        self._event_sent = self._event
        return batches, events

    def _state(self, sampler: Sampler) -> dict[str, Any]:
        space = sampler.runtime.facts["space"]
        return {
            "type": "state",
            "session": sampler.running,
            "mode": "openxr headless",
            "space": space,
            "visibility": "visible",
            "features": [space],
            "rate_hz": self._rate_hz,
            "held": len(self._held),
            "dropped": self._dropped,
        }


def main(arguments: Sequence[str] | None = None) -> None:
    """Sends this PC's headset to a recorder on another."""
    parser = argparse.ArgumentParser(prog="vrbench_openxr.relay", description=main.__doc__)
    parser.add_argument("url", help="the address that the recorder printed")
    parser.add_argument("--rate", type=float, default=500.0, help="poses a second")
    parser.add_argument("--space", choices=("local", "stage"), default="local")
    parser.add_argument("--ahead", type=float, default=0.0, help="ask so far ahead of now [s]")
    parser.add_argument(
        "--certificate", type=Path, help="PEM file of the recorder's certificate, to check it by"
    )
    options = parser.parse_args(arguments)
    try:
        relay = Relay(options.url, _tls(options.url, options.certificate), _say, options.rate)
        sampler = Sampler(
            Runtime(options.space),
            rate_hz=options.rate,
            ahead_s=options.ahead,
            on_pose=relay.on_pose,
            on_event=relay.on_event,
        )
        with sampler, contextlib.suppress(KeyboardInterrupt):
            relay.run(sampler, lambda: True)
    except VrbenchError as error:
        _say(f"error: {error}")
        sys.exit(error.exit_code)


def _tls(url: str, certificate: Path | None) -> ssl.SSLContext | None:
    """The recorder's certificate is its own: it is checked only where its file is given."""
    if not url.startswith("https"):
        return None
    context = ssl.create_default_context()
    context.check_hostname = certificate is not None
    if certificate is None:
        context.verify_mode = ssl.CERT_NONE
    else:
        try:
            context.load_verify_locations(certificate)
        except OSError as error:
            raise ConfigError("can't be used", file=certificate, fix=str(error)) from error
    return context


def _say(text: str) -> None:
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


if __name__ == "__main__":
    main()
