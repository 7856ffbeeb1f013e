"""The route `webxr`: a headset's browser as a source of poses."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from importlib.metadata import version
from typing import Self

from vrbench.devices.link import Link
from vrbench.devices.ports import Finding, Session
from vrbench.devices.specs import HeadsetProfile, HeadsetSpec
from vrbench.errors import DeviceError
from vrbench.streams import Columns
from vrbench_webxr.address import address, show, told
from vrbench_webxr.certificate import context
from vrbench_webxr.options import Options
from vrbench_webxr.server import Server, new_token
from vrbench_webxr.stand_in import stand_in

# How long a take waits for a headset that was there, and a take's end for its last frames.
READY_S = 15.0
LAST_FRAMES_S = 5.0
LOOK_S = 0.02
# How long `rig check` watches the frames.
WATCH_S = 2.0
LEAST_TRACKED = 0.95


class WebXRHeadset:
    """One session on the headset, kept over as many takes as the suite has.

    Entered, it serves the page and tells the address; the first take waits until a session runs.

    Attributes:
        url: where the page is.
        link: what is known of the headset.
    """

    def __init__(self, options: Options, _profile: HeadsetProfile | None, session: Session) -> None:
        self.link = Link()
        self.url = ""
        self._options, self._host = options, session.host
        self._stack = ExitStack()
        self._started = False
        self._server: Server | None = None

    @property
    def server(self) -> Server:
        """What serves the page, once it is served."""
        assert self._server is not None
        return self._server

    def __enter__(self) -> Self:
        self.serve()
        return self

    def serve(self) -> None:
        """Serves the page and tells where."""
        options = self._options
        tls = context(options.host, options.certificate, options.key) if options.https else None
        token = options.token or new_token()
        self._server = self._stack.enter_context(
            Server(
                self.link,
                self._host,
                address=options.host,
                port=options.port,
                token=token,
                tls=tls,
                rate_hz=options.rate_hz,
            )
        )
        self.url = address(options, self._server.port, token)
        if not options.quiet:
            show(told(options, self._server.port, self.url))

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def start(self, take: str) -> None:
        """Frames belong to this take from now on.

        The first take waits `wait_s` for a session: somebody has to put the headset on and press
        Start. Later ones wait for one that was there, and not for long.

        Raises:
            DeviceError: no session runs on the headset.
        """
        patience = READY_S if self._started else self._options.wait_s
        self._until(lambda: self.missing is None, patience)
        missing = self.missing
        if missing is not None:
            raise DeviceError(f"can't record {take}: {missing[0]}", field="headset", fix=missing[1])
        self._started = True
        server = self.server
        assert server.state is not None
        facts = server.state.model_dump(exclude={"type", "held", "session"})
        facts["pose_time"] = "display time where the browser gives it"
        self.link.begin(self._host.now(), facts)
        server.set_take(take)

    def facts(self) -> dict[str, str]:
        """Of the logger, which is this plugin's page: see `vrbench.devices.ports.facts_of`."""
        return {
            "logger_version": version("vrbench-webxr"),
            "prediction": "the browser's, to its display time",
            "world": self.link.world,
        }

    def read(self) -> Columns:
        """What has arrived since the last call, and whose times are known."""
        return self.link.take()

    def stop(self) -> None:
        """The take ends now; waits for the frames that are on their way, but not for ever."""
        self.link.end(self._host.now())
        if self._server is not None:
            self._server.set_take(None)
        self._until(lambda: self.link.complete, LAST_FRAMES_S)
        self.link.finish(self._host.now())

    @property
    def missing(self) -> tuple[str, str] | None:
        """What keeps the headset from being recorded, and what to do; None where nothing does."""
        link, server = self.link, self._server
        hello = None if server is None else server.hello
        if server is None or hello is None or not server.connected:
            return "no headset is connected", f"open {self.url} in its browser"
        if not hello.webxr:
            return f"this browser has no WebXR: {hello.reason}", f"open {self.url} on the headset"
        if server.state is None or not server.state.session:
            return "the headset's session isn't started", "press Start on the page"
        if not link.synchronised:
            return "the headset's clock isn't known yet", "wait a moment"
        if not link.awake(self._host.now()):
            return "no frames come", "wake the headset: put it on, or cover its proximity sensor"
        return None

    def findings(self, wait_s: float) -> Iterator[Finding]:
        """What `vrbench rig check` tells, after waiting for a session for so long."""
        self._until(lambda: self.missing is None, wait_s)
        missing = self.missing
        if missing is not None:
            yield Finding(False, *missing)
            return
        time.sleep(WATCH_S)
        server = self.server
        hello, state = server.hello, server.state
        assert hello is not None
        assert state is not None
        rate, tracked = self.link.rate(self._host.now())
        yield Finding(True, f"a session runs: {hello.agent or hello.client}")
        yield Finding(True, f"granted: {', '.join(state.features) or 'local'}")
        wanted = self._options.rate_hz or state.rate_hz
        slow = wanted is not None and rate < 0.9 * wanted
        said = f" of {wanted:g}" if wanted else ""
        yield Finding(
            not slow, f"{rate:.1f}{said} frames a second", "close what else runs on the headset"
        )
        yield Finding(
            tracked >= LEAST_TRACKED,
            f"{tracked:.0%} of frames tracked",
            "light, and something to see for its cameras",
        )
        yield Finding(True, f"clock known to {self.link.bound_s * 1e3:.2f} ms")
        yield Finding(
            hello.isolated,
            "the browser's clock is " + ("fine" if hello.isolated else "coarse: steps of 0.1 ms"),
            "a newer browser",
        )

    def _until(self, done: Callable[[], bool], seconds: float) -> None:
        end = time.monotonic() + seconds
        while not done() and time.monotonic() < end:
            time.sleep(LOOK_S)


def check(options: Options, session: Session) -> Iterator[Finding]:
    """Serves the page, waits for a session, and says what the headset gives."""
    headset = WebXRHeadset(options, None, session)
    with headset._stack:
        try:
            headset.serve()
        except DeviceError as error:
            yield Finding(False, error.what, error.fix or "")
            return
        yield Finding(True, f"the page is served at {headset.url}")
        yield from headset.findings(options.wait_s)


HEADSET = HeadsetSpec(
    name="webxr",
    title="Any headset with a browser, by WebXR; nothing is installed on it",
    options=Options,
    open=WebXRHeadset,
    check=check,
    emulator="vrbench_webxr.emulator",
    stand_in=stand_in,
)
