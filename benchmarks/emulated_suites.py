"""Runs the shipped suites on a rig of emulated devices: a UR5e, Motive, a headset.

    python -m benchmarks.emulated_suites [SUITE...] [--whole] [--route quest] [-o FOLDER]

As in a lab: over the devices' own protocols, in real time, with leave to move typed at a terminal,
and hands that do what the prompts ask for. The emulated headset errs more with cameras covered, and
is lost with all of them covered. Shortened, a suite has all its cases and conditions, but motions
of 24 s (calibrations: 60 s), rests of at most 12 s, two hours of at most 3 min, and one repeat;
`--whole` runs it as it is shipped.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from tests.live.lab import ROUTES, Lab
from vrbench.config.suite import Suite, load_suite
from vrbench.config.yaml_file import as_yaml
from vrbench.motion.files import Header, write_motion
from vrbench.motion.generators import REACH, saturating
from vrbench.results.bundle import Bundle
from vrbench.results.tables import read_rows

SUITES = (
    *("calibration", "static-jitter", "long-loop", "relocalisation", "gameplay-replay"),
    *("occluded-cameras", "speed-sweep"),
)
# Where a UR5e can do the motions of all suites but the quickest of speed-sweep.
START = "{p_m: [0.5754, 0.0082, 0.8157], yaw_deg: -85.53}"
HOLD_S, DURATION_S = 12.0, 180.0
SECONDS = {"calibration": 60.0, "check": 24.0, "head": 24.0, "opening": 24.0}


def main() -> int:
    """Prints what came of each; 1 where a run didn't end well, or a row has failed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("suites", nargs="*", default=SUITES, metavar="SUITE")
    parser.add_argument("--whole", action="store_true", help="as they are shipped")
    parser.add_argument("--route", choices=list(ROUTES), default="webxr")
    parser.add_argument("-o", dest="folder", type=Path, help="new folder that the runs stay in")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = given.folder or Path(made)
        for name in given.suites:
            (folder / name).mkdir(parents=True)
        codes = [
            run(folder / name, load_suite(name), given.route, whole=given.whole)
            for name in given.suites
        ]
    return max(codes)


def run(folder: Path, suite: Suite, route: str, *, whole: bool) -> int:
    """Runs one suite; its exit code."""
    path = folder / "suite.yaml"
    path.write_text(as_yaml(suite.canonical() if whole else short(suite, folder)), encoding="utf-8")
    begun = time.monotonic()
    lab = Lab(folder, path, START)
    try:
        with lab.vrbench("run", folder / "run", route=route) as typed:
            code = typed.end(patience_s=4 * 3600.0)
    finally:
        lab.close()
    (folder / "terminal.txt").write_text(typed.shown, encoding="utf-8")
    print(f"{suite.label}: exit code {code} after {time.monotonic() - begun:.0f} s", flush=True)
    if not (folder / "run" / "run.json").is_file():
        print(typed.shown[-2000:])
        return code
    bundle = Bundle.begun(folder / "run")
    takes = Counter(take.status for take in bundle.record.takes)
    print(f"  run {bundle.record.status}; takes: {dict(takes)}")
    table = folder / "run" / "metrics" / "vrbench-1.csv"
    if not table.is_file():
        print(f"  {bundle.record.reason}", flush=True)
        return code
    rows = read_rows(table)
    for reference in bundle.record.references:
        counted = Counter(row.status for row in rows if row.reference == reference)
        print(f"  rows against {reference}: {dict(counted)}")
    for why in sorted({row.reason for row in rows if row.reason}):
        print(f"  {why}", flush=True)
    return code


def short(suite: Suite, folder: Path) -> dict[str, Any]:
    """The same suite with shorter motions, written beside it, and fewer of them."""
    told = suite.canonical()
    for place, name in enumerate(sorted(told["motions"])):
        # each its own: what opens a loop must not look like it
        slower = 0.8 + 0.15 * place
        motion = saturating(name, name, SECONDS[name] / slower, 0.8 * REACH, slower)
        if name == "calibration":
            motion = saturating(name, name, SECONDS[name])
        header = Header(motion=name, version=1, up="y", rate_hz=120, source="generated")
        write_motion(folder / f"{name}.tum", header, motion.trajectory)
        told["motions"][name] = f"{name}.tum"
    for case in told["cases"]:
        case.pop("repeats", None)
        for knob, longest in (("hold", HOLD_S), ("duration", DURATION_S)):
            if knob in case:
                case[knob] = min(case[knob], longest)
    return told


if __name__ == "__main__":
    sys.exit(main())
