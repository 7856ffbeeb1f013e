"""How long `vrbench --help` takes with 50 plugins installed: CPU time and wall time [ms].

python benchmarks/help.py
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PLUGINS, TIMES = 50, 15
CODE = """
import numpy
from vrbench.devices.ports import HeadsetProfile, HeadsetSpec
from vrbench.plugin import hookimpl

@hookimpl
def vrbench_headsets():
    return [HeadsetSpec("made-up-{n}", "Made up", HeadsetProfile(72.0))]
"""


def install(folder: Path) -> None:
    """Puts the plugins into a folder, as pip would."""
    for n in range(PLUGINS):
        info = folder / f"vrbench_made_up_{n}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: vrbench-made-up-{n}\nVersion: 1.0\n", encoding="utf-8"
        )
        entry = f"[vrbench]\nmade-up-{n} = made_up_{n}\n"
        (info / "entry_points.txt").write_text(entry, encoding="utf-8")
        (folder / f"made_up_{n}.py").write_text(CODE.format(n=n), encoding="utf-8")


def measured(environment: dict[str, str], *command: str) -> tuple[float, float]:
    """Medians of CPU and wall time of a command [ms]."""
    cpu, wall = [], []
    for _ in range(TIMES):
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        wall.append(1e3 * (time.perf_counter() - begin))
        cpu.append(1e3 * (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime))
    return statistics.median(cpu), statistics.median(wall)


def main() -> None:
    """Prints a table."""
    vrbench = str(Path(sys.executable).with_name("vrbench"))
    with tempfile.TemporaryDirectory() as folder:
        install(Path(folder))
        environment = {**os.environ, "PYTHONPATH": folder}
        print(f"{PLUGINS} plugins, medians of {TIMES}     CPU ms   wall ms")
        for name, command in {
            "python -c pass": (sys.executable, "-c", "pass"),
            "vrbench --help": (vrbench, "--help"),
            "vrbench plugin list": (vrbench, "plugin", "list"),
        }.items():
            cpu, wall = measured(environment, *command)
            print(f"{name:<32} {cpu:8.0f} {wall:8.0f}")


if __name__ == "__main__":
    main()
