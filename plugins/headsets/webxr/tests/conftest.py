"""What the tests of the route share: a served page, and a browser that has an emulated headset."""

import shutil
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


@pytest.fixture(scope="session")
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
