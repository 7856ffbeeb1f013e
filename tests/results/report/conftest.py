"""A site of four runs, and Chromium to look at pages with."""

import json
import shutil
from hashlib import sha256
from pathlib import Path

import pytest

from vrbench.results.bundle import Bundle
from vrbench.results.leaderboard import leaderboard
from vrbench.results.report.run_page import write_report
from vrbench.results.report.site import write_site

FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
SCRIPT = "<script>document.title='taken'</script>"
# It would turn round what stands behind it, and is too long for any column.
TURNED = "\u202ebal" + 200 * "x"


def as_device(source: Path, folder: Path, headset: str, lab: str = "lab") -> Path:
    """A copy of a run as another device's."""
    shutil.copytree(source, folder)
    record = json.loads((folder / "run.json").read_text())
    record["device"]["headset"], record["lab"] = headset, lab
    for take in record["takes"]:
        take["sha256"] = sha256(f"{folder.name} {take['file']}".encode()).hexdigest()
    (folder / "run.json").write_text(json.dumps(record))
    return folder


@pytest.fixture(scope="session")
def runs(_run, tmp_path_factory) -> list[Path]:
    """Four runs; in the last one's names stand a script, and what turns texts round."""
    folder = tmp_path_factory.mktemp("secret-place")
    named = (("alpha", "lab"), ("beta", "lab"), ("gamma", "other"), (SCRIPT, f'"{SCRIPT}{TURNED}'))
    return [as_device(_run, folder / f"run {k}", *names) for k, names in enumerate(named)]


@pytest.fixture(scope="session")
def site(runs, tmp_path_factory) -> Path:
    broken = runs[0].with_name("broken")
    broken.mkdir(exist_ok=True)
    folders = [*runs, broken]
    out = tmp_path_factory.mktemp("site")
    write_site(leaderboard(folders, "vrbench-1"), folders, "vrbench-1", out, lambda *_: None)
    return out


@pytest.fixture(scope="session")
def report(runs) -> Path:
    """The report of the run that has a script in its names."""
    write_report(Bundle.open(runs[-1]), "vrbench-1")
    return runs[-1] / "report.html"


# A process has one Playwright at a time, and other tests have one too.
@pytest.fixture(scope="module")
def browser():
    sync_api = pytest.importorskip(
        "playwright.sync_api", reason="playwright is not here: pip install playwright"
    )
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("no Chromium is here: apt-get install chromium")
    with sync_api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        yield launched
        launched.close()


@pytest.fixture
def open_page(browser):
    """Opens a file; the page notes what went wrong, and what it asked for."""
    contexts = []

    def open_file(path, *, width=1280, height=900, scheme="light", script=True):
        context = browser.new_context(
            viewport={"width": width, "height": height},
            color_scheme=scheme,
            java_script_enabled=script,
        )
        contexts.append(context)
        page = context.new_page()
        page.problems, page.asked = [], []
        page.on("pageerror", lambda error: page.problems.append(str(error)))
        page.on("console", lambda message: page.problems.append(message.text))
        page.on("request", lambda request: page.asked.append(request.url))
        page.goto(path.as_uri())
        return page

    yield open_file
    for context in contexts:
        context.close()
