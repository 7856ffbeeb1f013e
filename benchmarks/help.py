"""How long `vrbench --help` takes with 50 plugins installed: CPU time and wall time [ms].

python -m benchmarks.help
"""

from __future__ import annotations

import statistics
import sys
import tempfile
from pathlib import Path

from benchmarks.measure import run

PLUGINS, TIMES = 50, 15
CODE = """
import numpy
from vrbench.devices.specs import HeadsetProfile, HeadsetSpec
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
    used = [run(command, environment=environment) for _ in range(TIMES)]
    median = statistics.median
    return 1e3 * median(one.cpu_s for one in used), 1e3 * median(one.wall_s for one in used)


def main() -> None:
    """Prints a table."""
    vrbench = str(Path(sys.executable).with_name("vrbench"))
    with tempfile.TemporaryDirectory() as folder:
        install(Path(folder))
        environment = {"PYTHONPATH": folder}
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
