"""How dear pages are: a leaderboard's site of many runs, and the report of a take of two hours.

    python benchmarks/site.py                 # 1000 runs
    python benchmarks/site.py --runs 100

The take is made up: 7200 s of a headset at 72 Hz over a robot at 100 Hz. For the site one run of
`gameplay-replay` is simulated (ten takes) and copied without its takes, each copy as a device, a
lab and a sitting of its own, with errors of its own size. CPU time is of this process.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import shutil
import subprocess
import sys
import time
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from vrbench.clocks import ClockMap
from vrbench.geometry import Floats, Transform, rotvec_to_quat
from vrbench.metrics.scored import ScoredTake
from vrbench.results.bundle import Bundle
from vrbench.results.files import file_digest
from vrbench.results.leaderboard import leaderboard
from vrbench.results.plot_curves import take_curves
from vrbench.results.plot_data import bins_for, curves_file, write_curves
from vrbench.results.report.run_page import run_page
from vrbench.results.report.site import write_site
from vrbench.streams import Columns, Samples
from vrbench.trajectory import NS, Trajectory

PROTOCOL = "vrbench-1"


def main() -> None:
    """Reads the options, runs both."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--from-run", type=Path, help="an evaluated run to copy [simulate one]")
    parser.add_argument("--keep", type=Path, help="leave runs and site in this new folder")
    asked = parser.parse_args()
    with TemporaryDirectory() as folder:
        place = asked.keep or Path(folder)
        source = asked.from_run or simulated(place / "source")
        report(Bundle.open(source))
        long_report(source, place / "long")
        site(source, asked.runs, place)


def simulated(folder: Path) -> Path:
    """A simulated run."""
    command = [sys.executable, "-m", "vrbench", "run", "gameplay-replay", "--rig", "sim:quest-2"]
    subprocess.run([*command, "-o", str(folder)], check=True, capture_output=True)
    return folder


def report(bundle: Bundle) -> None:
    """What the report of a run costs."""
    began = time.process_time()
    page = run_page(bundle, PROTOCOL)
    spent = time.process_time() - began
    takes = len(bundle.record.takes)
    print(f"report of {takes} takes: {len(page.encode()) / 1e6:.2f} MB, {spent:.2f} s CPU")


def long_report(source: Path, folder: Path) -> None:
    """What the curves and the report of a take of two hours cost."""
    copied(source, folder, 0)
    record = json.loads((folder / "run.json").read_text())
    take = made_up(7200.0)
    began = time.process_time()
    name = Bundle.open(source).record.takes[0]
    curves = take_curves(name, take, {"all": take}, "robot", bins_for(1))
    spent = time.process_time() - began
    write_curves([curves], PROTOCOL, folder / curves_file(PROTOCOL))
    record["files"][curves_file(PROTOCOL)] = file_digest(folder / curves_file(PROTOCOL))
    (folder / "run.json").write_text(json.dumps(record))
    page = run_page(Bundle.open(folder), PROTOCOL)
    print(
        f"take of 2 h, {curves.samples} samples: curves {spent:.1f} s CPU, "
        f"report {len(page.encode()) / 1e6:.2f} MB"
    )


def made_up(seconds: float) -> ScoredTake:
    """A take ready to be scored: a slow swing, errors of a millimetre that last two seconds."""
    rng = np.random.default_rng(1)
    reference, estimate = (swing(np.arange(0.0, seconds, 1 / rate)) for rate in (100.0, 72.0))
    grid = np.arange(0.0, seconds + 2.0, 2.0)
    at = (estimate.t - estimate.t[0]) / NS
    error = np.stack([np.interp(at, grid, rng.normal(0.0, 6e-4, len(grid))) for _ in range(3)], 1)
    identity = Transform.identity()
    moved = Trajectory(estimate.t, Transform(estimate.pose.p + error, estimate.pose.q))
    samples = Samples.of(moved.t, moved.pose)
    clock = ClockMap(np.array([0]), np.array([0.0]))
    columns = Columns({"headset/eye": samples})
    return ScoredTake(columns, reference, samples, moved, estimate.pose, clock, identity, identity)


def swing(t: Floats) -> Trajectory:
    """A smooth motion at times t (n,) [s]."""
    phase = t[:, None] * np.array([0.31, 0.43, 0.57])
    pose = Transform(0.2 * np.sin(phase), rotvec_to_quat(0.3 * np.sin(1.3 * phase)))
    return Trajectory(np.rint(t * NS).astype(np.int64), pose)


def site(source: Path, count: int, place: Path) -> None:
    """What a site of many runs costs."""
    runs = [copied(source, place / "runs" / f"run-{k:04d}", k) for k in range(count)]
    began = time.process_time()
    found = leaderboard(runs, PROTOCOL)
    ranked = time.process_time()
    write_site(found, runs, PROTOCOL, place / "site", lambda *_: None)
    ended = time.process_time()
    sizes = {path.name: path.stat().st_size for path in (place / "site").iterdir()}
    largest = max((size, name) for name, size in sizes.items() if name.endswith(".html"))
    print(f"{count} runs: boards {ranked - began:.1f} s CPU, and the site {ended - ranked:.1f} s")
    print(
        f"{len(sizes)} files, {sum(sizes.values()) / 1e6:.0f} MB; largest page {largest[1]}, "
        f"{largest[0] / 1e6:.2f} MB; script {sizes['vrbench.js'] / 1e3:.0f} kB"
    )


def copied(source: Path, folder: Path, k: int) -> Path:
    """A copy of a run, as another device's; its ranking errors are scaled."""
    rng = np.random.default_rng(k)
    factor = float(rng.uniform(0.6, 1.6))
    (folder / "metrics").mkdir(parents=True)
    for name in ("calibration.json", "suite.yaml", "rig.yaml"):
        shutil.copy(source / name, folder / name)
    for name in (f"metrics/{PROTOCOL}.csv", f"metrics/{PROTOCOL}.phase.csv"):
        (folder / name).write_text(scaled((source / name).read_text(), factor))
    shutil.copy(source / curves_file(PROTOCOL), folder / curves_file(PROTOCOL))
    record = json.loads((source / "run.json").read_text())
    record["device"] |= {"headset": f"device-{k % 40:02d}", "firmware": f"{k // 40}.0"}
    record["lab"], record["sitting"] = f"lab-{k % 7}", f"sitting-{k}"
    for take in record["takes"]:
        take["sha256"] = sha256(f"{k} {take['file']}".encode()).hexdigest()
    record["files"] = {
        name: sha256((folder / name).read_bytes()).hexdigest()
        for name in record["files"]
        if (folder / name).is_file()
    }
    (folder / "run.json").write_text(json.dumps(record))
    return folder


def scaled(text: str, factor: float) -> str:
    """A table with its errors of translation scaled."""
    rows = list(csv.DictReader(io.StringIO(text)))
    for row in rows:
        if row["metric"].startswith("ape.translation") and row["unit"] == "mm":
            for name, power in (
                ("value", 1),
                ("ci_low", 1),
                ("ci_high", 1),
                ("mean", 1),
                ("mean_square", 2),
            ):
                if row.get(name):
                    row[name] = f"{float(row[name]) * factor**power:.9g}"
    out = io.StringIO()
    table = csv.DictWriter(out, rows[0], lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return out.getvalue()


if __name__ == "__main__":
    main()
