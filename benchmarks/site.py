"""How dear pages are: a leaderboard's site of many runs, and the report of a take of two hours.

    python benchmarks/site.py                 # 1000 runs
    python benchmarks/site.py --runs 100

One run of `gameplay-replay` is simulated (ten takes) and copied without its takes, each copy as a
device, a lab and a sitting of its own, with errors of its own size. CPU time is of this process.
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

from vrbench.results.bundle import Bundle
from vrbench.results.leaderboard import leaderboard
from vrbench.results.plot_data import curves_file
from vrbench.results.report.run_page import run_page
from vrbench.results.report.site import write_site

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
    print(
        f"{count} runs: boards {ranked - began:.1f} s CPU, site {ended - began:.1f} s CPU with them"
    )
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
