"""Runs the evo that is installed on the same poses, to check our numbers against its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from importlib.metadata import entry_points, version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING
from zipfile import ZipFile

import click

from vrbench.errors import ConfigError, EstimationError

if TYPE_CHECKING:
    from vrbench.metrics.as_evo import Question
    from vrbench.trajectory import Stamped

LARGEST_DIFFERENCE = 1e-9
# A number below it is as good as nought: of equal trajectories both tools print rounding errors.
SMALL = 1e-3
LETTERS = {"frames": "f", "m": "m", "deg": "d", "rad": "r"}


def run_evo(
    reference: str, truth: Stamped, estimate: str, found: Stamped, question: Question
) -> dict[str, float]:
    """Evo's statistics by name, to the last digit.

    evo reads the files itself. Only where one is TUM and the other MCAP, which it can't mix, it is
    given both as TUM, with every digit.

    Raises:
        ConfigError: evo isn't installed.
        EstimationError: evo refuses the files.
    """
    from vrbench.recording.poses import split

    name = "evo_ape" if question.delta is None else "evo_rpe"
    start = _program(name)
    (reference_file, reference_topic), (estimate_file, estimate_topic) = (
        split(reference),
        split(estimate),
    )
    with TemporaryDirectory() as folder:
        if reference_topic and estimate_topic and reference_file == estimate_file:
            what = ["mcap", str(reference_file), reference_topic, estimate_topic]
        elif reference_topic or estimate_topic:
            what = ["tum", _as_tum(truth, folder, "ref"), _as_tum(found, folder, "est")]
        else:
            what = ["tum", str(reference_file), str(estimate_file)]
        results = Path(folder) / "results.zip"
        words = [*start, *what, *_options(question), "--save_results", str(results)]
        done = subprocess.run(
            words, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
        )
        if done.returncode != 0 or not results.is_file():
            said = (done.stderr or done.stdout).strip().splitlines()
            raise EstimationError(f"{name} fails: {said[-1] if said else 'without a word'}")
        with ZipFile(results) as content:
            numbers: dict[str, float] = json.loads(content.read("stats.json"))
    return numbers


def show_check(ours: Mapping[str, float], theirs: Mapping[str, float]) -> int:
    """Prints both, and the largest difference as a part of the number; 1 if it is too large."""
    click.echo(f"{'':>10}\t{'vrbench':<22}\tevo {version('evo')}")
    for name, value in ours.items():
        click.echo(f"{name:>10}\t{value:<22.16g}\t{theirs[name]:.16g}")
    worst = max(ours, key=lambda name: difference(ours[name], theirs[name]))
    largest = difference(ours[worst], theirs[worst])
    agrees = largest <= LARGEST_DIFFERENCE
    verdict = "agrees with" if agrees else "DIFFERS from"
    click.echo(f"{verdict} evo: largest difference {largest:.1e} of the number, in {worst}")
    return 0 if agrees else 1


def difference(ours: float, theirs: float) -> float:
    """How far apart, as a part of evo's number, or of `SMALL` where that is more."""
    return abs(ours - theirs) / max(abs(theirs), SMALL)


def _program(name: str) -> list[str]:
    """The words that start one of evo's programs, wherever it is installed."""
    found = next(iter(entry_points(group="console_scripts", name=name)), None)
    if found is None:
        raise ConfigError(
            "evo is not installed", field="--cross-check", fix="pip install 'vrbench[evo]'"
        )
    code = f"import sys; sys.argv[0] = {name!r}; from {found.module} import {found.attr} as f; f()"
    return [sys.executable, "-c", code]


def _options(question: Question) -> list[str]:
    words = ["--t_max_diff", repr(question.max_diff_s), "--no_warnings"]
    words += ["-r", "angle_deg" if question.rotation else "trans_part"]
    words += ["--align"] if question.aligned else []
    if question.delta is not None:
        unit = LETTERS[question.delta.unit]
        words += ["--delta", repr(question.delta.value), "--delta_unit", unit]
        words += ["--all_pairs"] if question.delta.all_pairs else []
    return words


def _as_tum(poses: Stamped, folder: str, name: str) -> str:
    """A TUM file of the poses, with every digit."""
    path = Path(folder) / f"{name}.tum"
    rows = zip(poses.t.tolist(), poses.pose.p.tolist(), poses.pose.q.tolist(), strict=True)
    text = "".join(" ".join(map(repr, (t, *p, *q))) + "\n" for t, p, q in rows)
    path.write_text(text, encoding="utf-8")
    return str(path)
