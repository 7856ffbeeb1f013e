"""What the tests of the route share: a served page, and a browser that has an emulated headset."""

import contextlib
import shutil
import socket
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from vrbench_webxr.emulator import FakePage, sway
from vrbench_webxr.options import Options
from vrbench_webxr.route import WebXRHeadset

from vrbench.devices.host import RealClock
from vrbench.devices.ports import Session
from vrbench.geometry import Transform

HERE = Path(__file__).parent
IWER = HERE / "browser" / "node_modules" / "iwer" / "build" / "iwer.min.js"
FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
    "--disable-background-timer-throttling",
    "--disable-renderer-backgrounding",
    "--disable-backgrounding-occluded-windows",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


def session():
    return Session(RealClock(), Transform.identity(), seed=0)


def _wait_for(condition, seconds=10.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "what was waited for did not come"
        time.sleep(0.01)


@contextmanager
def _serving(**options):
    headset = WebXRHeadset(
        Options(**{"listen": "127.0.0.1:0", "quiet": True, **options}), None, session()
    )
    headset.serve()
    try:
        yield headset
    finally:
        headset.__exit__(None, None, None)


@pytest.fixture
def wait_for():
    """Waits until a condition holds, for ten seconds at most."""
    return _wait_for


@pytest.fixture
def serving():
    """Serves a page with options of the test's own."""
    return _serving


@pytest.fixture
def headset():
    with _serving() as served:
        yield served


@pytest.fixture
def page(headset):
    """A fake page with a session, whose clock is known."""
    with FakePage(headset.url) as fake:
        fake.begin_session()
        fake.frame(*sway(0.0))
        _wait_for(lambda: headset.link.synchronised and headset.server.state is not None)
        yield fake


class Relay:
    """Passes TCP connections on; what goes over those there are can be swallowed, unnoticed."""

    def __init__(self, port):
        self._to = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._sockets, self._swallowed = [], set()
        threading.Thread(target=self._accept, daemon=True).start()

    def swallow(self):
        """Connections there are go silent; later ones work."""
        self._swallowed |= set(self._sockets)

    def close(self):
        for each in (self._listener, *self._sockets):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _accept(self):
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                far = socket.create_connection(("127.0.0.1", self._to))
                self._sockets += [near, far]
                for ends in ((near, far), (far, near)):
                    threading.Thread(target=self._pass_on, args=ends, daemon=True).start()

    def _pass_on(self, source, sink):
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                if source not in self._swallowed:
                    sink.sendall(data)
            if source not in self._swallowed:
                sink.shutdown(socket.SHUT_WR)


@pytest.fixture
def relayed():
    """Makes a relay in front of a port."""
    relays = []

    def make(port):
        relays.append(Relay(port))
        return relays[-1]

    yield make
    for relay in relays:
        relay.close()


# A process has one Playwright at a time, and other tests have one too.
@pytest.fixture(scope="module")
def browser():
    sync_api = pytest.importorskip(
        "playwright.sync_api", reason="playwright is not here: pip install playwright"
    )
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("no Chromium is here: apt-get install chromium")
    if not IWER.exists():
        pytest.skip(f"iwer is not here: npm ci --prefix {IWER.parents[3].relative_to(HERE)}")
    with sync_api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        yield launched
        launched.close()


@pytest.fixture
def open_page(browser):
    """Opens an address in the browser, with an emulated headset of a model or without any."""
    contexts = []

    def open_at(url, device=None, rate_hz=90.0, script=""):
        context = browser.new_context(
            viewport={"width": 1280, "height": 800}, ignore_https_errors=True
        )
        contexts.append(context)
        page = context.new_page()
        page.problems = []
        page.on("pageerror", lambda error: page.problems.append(str(error)))
        if device:
            page.add_init_script(f"window.RIG = {{device: '{device}', rateHz: {rate_hz}}};")
            page.add_init_script(path=IWER)
            page.add_init_script(path=HERE / "injected.js")
        if script:
            page.add_init_script(script)
        page.goto(url)
        return page

    yield open_at
    for context in contexts:
        context.close()
