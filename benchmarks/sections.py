"""What `make bench` measures: each section runs peers and vrbench on the same files, in turn."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.files import take_file, tum_files
from benchmarks.measure import (
    FailedError,
    Measured,
    exponent,
    free_mb,
    in_turn,
    installed,
    missing,
    program,
    run,
    seconds,
    table,
    times,
    work,
)

MINUTES = {2: "2 min", 20: "20 min", 120: "2 h"}
HEADSET_HZ = 72
SUITE = """
suite: one-take
version: 1
title: One take between two calibrations
motions: {head: shooter-1, calibration: saturate-1}
cases:
  - {id: calibrate, motion: calibration, role: calibration}
  - {id: replay, motion: head, needs: [x, clock, y], anchor: 10 s}
metrics: [ape, rpe, scale, coverage, timing, clock, replay]
gate: {handeye.translation: 15 mm, handeye.rotation: 0.5 deg, max_age: 60 min, bracket: 1 mm}
rank: {metric: ape.translation.aligned, point: eye, statistic: rmse, min_coverage: 95 %}
"""


@dataclass(frozen=True, slots=True)
class Extent:
    """How much is measured.

    Attributes:
        folder: where files are made, and kept.
        rounds: how often each contestant runs.
        quick: only small sizes: to see that it works, and its order of size.
    """

    folder: Path
    rounds: int
    quick: bool

    def sizes(self, *all_sizes: int) -> tuple[int, ...]:
        """All of them, or all but the last where it is to be quick."""
        return all_sizes[:-1] if self.quick else all_sizes


def compared(found: dict[str, Measured]) -> list[list[str]]:
    """A row for each contestant: CPU, memory, and how many times the first one's CPU."""
    return [
        [name, seconds(one.cpu_s), f"{one.peak_mb:.0f}", times(one.ratio)]
        for name, one in found.items()
    ]


COMPARED = ("", "CPU s", "peak MB", "CPU, ours = 1")


def grown(sizes: tuple[int, ...], found: list[dict[str, Measured]], what: str) -> str:
    """Cost against size, with its exponent."""
    rows = []
    for name in found[0]:
        costs = [one[name].cpu_s for one in found if name in one]
        power = f"{exponent(sizes[: len(costs)], costs):.2f}" if len(costs) > 1 else ""
        cells = [seconds(c) for c in costs] + ["left out"] * (len(sizes) - len(costs))
        rows.append([name, *cells, power])
    return table(["CPU s", *(f"{size} {what}" for size in sizes), "exponent"], rows)


def ape(extent: Extent) -> Iterator[str]:
    """`vrbench ape` beside evo's programs, whole processes."""
    yield from missing("evo")
    ours, evo = [program("vrbench"), "ape"], installed("evo") is not None
    sizes, found = extent.sizes(*MINUTES), []
    for minutes in sizes:
        reference, estimate = tum_files(extent.folder, 60 * minutes)
        take = take_file(extent.folder, 60 * minutes, joints=False)
        topics = [f"{take}:/robot/tcp", f"{take}:/headset/eye/pose"]
        contestants = {
            "vrbench ape --align": [*ours, reference, estimate, "--align"],
            "vrbench ape --align, of a take": [*ours, *topics, "--align"],
            "vrbench ape --rpe '72 frames'": [*ours, reference, estimate, "--rpe", "72 frames"],
        }
        if evo:
            files = ["tum", reference, estimate]
            contestants |= {
                "evo_ape tum -va": [program("evo_ape"), *files, "-va"],
                "evo_rpe tum -d 72": [program("evo_rpe"), *files, "-d", "72", "-u", "f"],
                "evo_traj tum --ref": [program("evo_traj"), "tum", estimate, "--ref", reference],
            }
        found.append(in_turn(contestants, extent.rounds))
        yield f"**{MINUTES[minutes]}** ({7200 * minutes} and {4320 * minutes} poses)"
        yield table(COMPARED, compared(found[-1]))
    yield grown(sizes, found, "min")


def metrics(extent: Extent) -> Iterator[str]:
    """The whole set at once, beside the runs of evo that it replaces."""
    yield from missing("evo")
    if installed("evo") is None:
        return
    for minutes in (2,) if extent.quick else (20, 120):
        yield f"**{MINUTES[minutes]}**"
        yield _whole_set(*tum_files(extent.folder, 60 * minutes))


def _whole_set(reference: Path, estimate: Path) -> str:
    """A table of one length."""
    deltas = {"1 frame": ("1", "f"), "72 frames": ("72", "f"), "1 m": ("1", "m")}
    words = [word for delta in deltas for word in ("--rpe", delta)]
    contestants = {
        "vrbench ape --align --all, 3 deltas": [
            *(program("vrbench"), "ape", reference, estimate, "--align", "--all"),
            *words,
        ]
    }
    for part in ("trans_part", "angle_deg"):
        common = ["tum", reference, estimate, "-a", "-r", part]
        contestants[f"evo_ape -a -r {part}"] = [program("evo_ape"), *common]
        for value, unit in deltas.values():
            name = f"evo_rpe -a -r {part} -d {value} -u {unit}"
            contestants[name] = [program("evo_rpe"), *common, "-d", value, "-u", unit]
    found = in_turn(contestants, 1)
    ours, *theirs = found.values()
    rows = compared(found)
    total = sum(one.cpu_s for one in theirs)
    rows.append([f"evo, {len(theirs)} runs", seconds(total), "", times(total / ours.cpu_s)])
    return table(COMPARED, rows)


def mcap(extent: Extent) -> Iterator[str]:
    """A million poses written and read, and a take of two hours."""
    yield from missing("mcap-ros2-support", "foxglove-sdk", "rosbags")
    count = 120_000 if extent.quick else 1_000_000
    folder = extent.folder
    writers = {"vrbench, columns": "write-vrbench", "mcap, bytes": "write-mcap"}
    if installed("foxglove-sdk"):
        writers["foxglove-sdk, bytes"] = "write-foxglove"
    if installed("rosbags"):
        writers["rosbags, bytes"] = "write-rosbags"
    used: dict[str, list[float]] = {}
    for number in range(extent.rounds):
        for name, job in writers.items():
            path = folder / f"written-{job}-{count}.mcap"
            path = path.with_suffix("") if job == "write-rosbags" else path
            _remove(path)
            told = run(work(job, path, count))
            used.setdefault(name, []).append(
                1e6 * told.cpu_s / told.told.get("messages", float(count))
            )
            if number or job != "write-vrbench":
                _remove(path)
    yield f"**Writing {count} poses**, zstd"
    rows = [[name, f"{sorted(us)[len(us) // 2]:.2f}"] for name, us in used.items()]
    yield table(["", "CPU us a message"], rows)
    _remove(folder / f"written-write-vrbench-{count}.mcap")
    file = take_file(folder, count // 120, joints=False)
    readers = {"vrbench, to arrays": "read-vrbench", "mcap, bytes to arrays": "read-mcap"}
    if installed("rosbags"):
        readers["rosbags, objects"] = "read-rosbags"
    if installed("mcap-ros2-support"):
        readers["mcap-ros2-support, objects"] = "read-ros2"
    found = in_turn({name: work(job, file) for name, job in readers.items()}, extent.rounds)
    yield f"**Reading {count} poses** of a take"
    yield table(
        ["", "CPU us a pose", "peak MB", "CPU, ours = 1"],
        [
            [name, f"{1e6 * m.cpu_s / m.told['poses']:.2f}", f"{m.peak_mb:.0f}", times(m.ratio)]
            for name, m in found.items()
        ],
    )
    sizes, whole = extent.sizes(*MINUTES), []
    rows = []
    for minutes in sizes:
        take = take_file(folder, 60 * minutes)
        whole.append(in_turn({"vrbench": work("read-take", take)}, extent.rounds))
        one = whole[-1]["vrbench"]
        us = 1e6 * one.cpu_s / one.told["messages"]
        cells = [f"{one.told['messages']:.0f}", seconds(one.cpu_s), f"{us:.2f}"]
        rows.append([MINUTES[minutes], *cells, f"{one.peak_mb:.0f}"])
    yield "**A take with joints at 500 Hz, to arrays**"
    yield table(["", "messages", "CPU s", "us a message", "peak MB"], rows)
    yield grown(sizes, whole, "min")


def _remove(path: Path) -> None:
    import shutil

    shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


METHODS = ("tsai", "park", "horaud", "andreff", "daniilidis")
# Daniilidis' keeps (n^2 / 2, 6 x 8) numbers several times over: 5 GB at 3000 poses.
MB_PER_PAIR = 5_500 / (3000 * 3000)


def handeye(extent: Extent) -> Iterator[str]:
    """X from 100 to 3000 poses, beside OpenCV's five methods."""
    yield from missing("opencv-python-headless")
    sizes, found, errors = extent.sizes(100, 1000, 3000), [], []
    for count in sizes:
        contestants = {"vrbench": work("handeye-vrbench", count)}
        need = MB_PER_PAIR * count * count
        for method in METHODS if installed("opencv-python-headless") else ():
            if need > 0.8 * free_mb():
                yield f"Left out: {method} of {count} poses, {need:.0f} MB are not free."
                continue
            contestants[f"cv2 {method}"] = work("handeye-opencv", method, count)
        found.append(in_turn(contestants, 1 if count > 1000 else extent.rounds))
        errors.append(found[-1])
        rows = [
            [
                name,
                *(f"{1e3 * m.cpu_s:.1f}", f"{m.peak_mb:.0f}", times(m.ratio)),
                *(f"{m.told['mm']:.3f}", f"{m.told['deg']:.4f}"),
            ]
            for name, m in found[-1].items()
        ]
        yield f"**{count} poses**, 1 mm and 0.1 deg of noise"
        header = ("", "CPU ms", "peak MB", "CPU, ours = 1", "X off by mm", "deg")
        yield table(header, rows)
    yield grown(sizes, found, "poses")


def clock(extent: Extent) -> Iterator[str]:
    """The offset of two clocks, beside the peak detection of Banaszczyk et al. (2024)."""
    sizes, found = extent.sizes(120, 1200, 7200), []
    for span in sizes:
        jobs = {"vrbench, angular speed": "clock-vrbench", "peaks of height, paired": "clock-peaks"}
        contestants = {name: work(job, span) for name, job in jobs.items()}
        found.append(in_turn(contestants, extent.rounds))
        yield f"**{span} s at 72 Hz**"
        rows = [
            [name, f"{1e3 * m.cpu_s:.1f}", times(m.ratio), f"{m.told['ms']:.3f}"]
            for name, m in found[-1].items()
        ]
        yield table(["", "CPU ms", "CPU, ours = 1", "off by ms"], rows)
    yield grown(sizes, found, "s")


def inverse(extent: Extent) -> Iterator[str]:
    """All postures of a UR5e, beside EAIK and ur-analytic-ik; and a whole plan."""
    if installed("vrbench-ur") is None:
        yield "Left out: vrbench-ur is not installed: `make .venv/test`."
        return
    yield from missing("eaik", "ur-analytic-ik")
    sizes, found = extent.sizes(1_000, 10_000, 100_000), []
    for count in sizes:
        contestants = {"vrbench-ur": work("inverse-vrbench", count)}
        for package, job in (("eaik", "inverse-eaik"), ("ur-analytic-ik", "inverse-analytic")):
            if installed(package):
                contestants[package] = work(job, count)
        found.append(in_turn(contestants, extent.rounds))
    rows = [
        [
            name,
            *(f"{1e6 * m.cpu_s / sizes[-1]:.2f}", times(m.ratio)),
            f"{m.told['postures'] / sizes[-1]:.3f}",
        ]
        for name, m in found[-1].items()
    ]
    yield f"**{sizes[-1]} poses within reach**"
    yield table(["", "CPU us a pose", "CPU, ours = 1", "postures a pose"], rows)
    yield grown(sizes, found, "poses")
    plan = run(work("plan-vrbench", 0))
    yield (
        f"A plan of {plan.told['poses']:.0f} poses (two minutes at 120 Hz: all postures, the "
        f"cheapest way through them, limits, collisions): {plan.cpu_s:.2f} s."
    )


def evaluate(extent: Extent) -> Iterator[str]:
    """From takes to rows: a run with one two-minute take, its stages, and one of two hours."""
    short = extent.folder / "one-take"
    if not (short / "run.json").exists():
        (extent.folder / "one-take.yaml").write_text(SUITE, encoding="utf-8")
        suite = str(extent.folder / "one-take.yaml")
        run([program("vrbench"), "record", suite, "--rig", "sim:quest-2", "-o", str(short)])
    found = in_turn(
        {
            "`vrbench evaluate`, the whole run of three takes": [
                *(program("vrbench"), "evaluate", str(short))
            ],
            "read a take": work("stage-read", short),
            "calibrate: clock, hand-eye, fit": work("stage-calibrate", short),
            "make the take ready: clock, fit of offset and Y": work("stage-prepare", short),
            "of that, the fit": work("stage-fit", short),
            "its metrics and intervals": work("stage-score", short),
        },
        extent.rounds,
    )
    yield "**Two minutes**: a calibration, a take, a calibration; sim:quest-2"
    rows = [[name, seconds(m.cpu_s), f"{m.peak_mb:.0f}"] for name, m in found.items()]
    yield table(["", "CPU s", "peak MB"], rows)
    if extent.quick:
        return
    long = extent.folder / "long-loop"
    if not (long / "run.json").exists():
        run([program("vrbench"), "record", "long-loop", "--rig", "sim:quest-2", "-o", str(long)])
    one = run([program("vrbench"), "evaluate", str(long)])
    yield "**Two hours**: `vrbench evaluate` of `long-loop`, 518 400 poses in 58 loops"
    yield table(
        ["", "CPU s", "peak MB"], [["vrbench evaluate", seconds(one.cpu_s), f"{one.peak_mb:.0f}"]]
    )


def limits(extent: Extent) -> Iterator[str]:
    """What this machine can do at best: bytes read, unpacked, copied, and how far stages are."""
    minutes = 2 if extent.quick else 120
    text, _ = tum_files(extent.folder, 60 * minutes)
    take = take_file(extent.folder, 60 * minutes)
    megabytes = 400
    floor = in_turn(
        {
            "reading bytes": work("limit-read", take),
            "unpacking zstd": work("limit-unpack", take),
            "copying memory": work("limit-copy", megabytes),
            "a take to arrays": work("stage-take", take),
            "TUM text to arrays": work("stage-text", text),
        },
        extent.rounds,
    )
    rows = []
    for name, m in floor.items():
        ns = 1e9 * m.cpu_s / m.told["bytes"]
        rows.append([name, f"{m.told['bytes'] / 1e6:.0f}", seconds(m.cpu_s), f"{ns:.2f}"])
    yield table(["", "MB", "CPU s", "ns a byte"], rows)


SECTIONS: dict[str, Callable[[Extent], Iterator[str]]] = {
    "ape": ape,
    "metrics": metrics,
    "mcap": mcap,
    "handeye": handeye,
    "clock": clock,
    "inverse": inverse,
    "evaluate": evaluate,
    "limits": limits,
}

TITLES = {
    "ape": "APE and RPE",
    "metrics": "The whole set of metrics",
    "mcap": "Takes: MCAP",
    "handeye": "Hand-eye calibration",
    "clock": "Clock offset",
    "inverse": "Planner",
    "evaluate": "Evaluation",
    "limits": "Limits of the machine",
}

__all__ = ["SECTIONS", "TITLES", "Extent", "FailedError"]
