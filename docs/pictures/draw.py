"""Draws the pictures of README and docs anew, of the demo's runs.

    make demo && .venv/bin/python docs/pictures/draw.py

Needs Chromium, and playwright, which `make test` installs.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

HERE = Path(__file__).parent
RUNS = HERE.parents[1] / "runs" / "demo"
# Of the report, its first three plots.
HEIGHT = 820


def main() -> None:
    """Writes board.png and report.png beside this file."""
    runs = [RUNS / name for name in ("quest-2", "quest-pro")]
    with tempfile.TemporaryDirectory() as made, sync_playwright() as playwright:
        site = Path(made) / "site"
        words = ["leaderboard", *map(str, runs), "--format", "html", "-o", str(site)]
        subprocess.run([sys.executable, "-m", "vrbench", *words], check=True)
        (board,) = site.glob("board-*.html")
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"))
        page = browser.new_page(viewport={"width": 1100, "height": 900})
        page.goto(board.as_uri())
        page.locator("figure").first.screenshot(path=HERE / "board.png")
        page.goto((runs[1] / "report.html").as_uri())
        seen = page.locator("#figures").bounding_box()
        assert seen is not None
        page.screenshot(path=HERE / "report.png", full_page=True, clip={**seen, "height": HEIGHT})
        browser.close()


if __name__ == "__main__":
    main()
