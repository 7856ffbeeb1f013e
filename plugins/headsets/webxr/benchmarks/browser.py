"""WebXR in a real Chromium, with Meta's emulator as the headset: 120 Hz for a minute.

    python plugins/headsets/webxr/benchmarks/browser.py [--seconds 60] [--rate 120]

Needs what the browser tests need: see the README. Prints frames, gaps, the largest difference of a
pose from the one injected, and what is known of the clock. Intervals are of the emulator's pacing.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright
from vrbench_webxr.options import Options
from vrbench_webxr.route import WebXRHeadset

from vrbench.devices.host import RealClock
from vrbench.devices.ports import Session
from vrbench.geometry import Transform

TESTS = Path(__file__).parents[1] / "tests"
FLAGS = re.findall(r'"(--[a-z=-]+)"', (TESTS / "conftest.py").read_text(encoding="utf-8"))


def main() -> None:
    """Records, compares, prints."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=int, default=120)
    parser.add_argument("--device", default="metaQuest3")
    options = parser.parse_args()
    session = Session(RealClock(), Transform.identity(), 0)
    headset = WebXRHeadset(Options(listen="127.0.0.1:0", quiet=True), None, session)
    headset.serve()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_page()
        page.add_init_script(f"window.RIG={{device:'{options.device}',rateHz:{options.rate}}};")
        page.add_init_script(path=TESTS / "browser/node_modules/iwer/build/iwer.min.js")
        page.add_init_script(path=TESTS / "injected.js")
        page.goto(headset.url)
        page.get_by_role("button", name="Start").click()
        while headset.missing is not None:
            page.wait_for_timeout(50)
        cpu = time.process_time()
        headset.start("benchmark")
        page.wait_for_timeout(1000 * options.seconds)
        headset.stop()
        cpu = time.process_time() - cpu
        columns = headset.read()
        count = page.evaluate("INJECTED.frames()")
        script = f"Array.from({{length: {count}}}, (_, k) => INJECTED.path(k))"
        injected = np.array(page.evaluate(script))
        browser.close()
    headset.__exit__(None, None, None)
    samples = columns.poses["headset/eye"]
    first = int(np.argmin(np.abs(injected[:, :3] - samples.pose.p[0]).sum(axis=1)))
    meant = injected[first : first + len(samples)]
    signs = np.sign(np.sum(samples.pose.q * meant[:, 3:], axis=1))[:, None]
    interval = np.diff(columns.joints["headset/frames"].position[:, 2])
    told = {
        "frames": len(samples),
        "good": int(samples.good.sum()),
        "sequence gaps": sum(event.detail.get("kind") == "sequence" for event in columns.events),
        "largest position difference m": float(np.abs(samples.pose.p - meant[:, :3]).max()),
        "largest quaternion difference": float(np.abs(samples.pose.q * signs - meant[:, 3:]).max()),
        "interval ms, median and 99.9 %": np.percentile(interval, (50, 99.9)).round(3).tolist(),
        "clock exchanges": len(columns.clocks["headset"]),
        "clock bound ms": round(headset.link.bound_s * 1e3, 3),
        "recorder's cores": round(cpu / options.seconds, 3),
        "events": sorted({event.kind for event in columns.events}),
    }
    print(json.dumps(told, indent=1))


if __name__ == "__main__":
    main()
