"""What tests share: a short suite, a run of it on a simulated rig, and the folder of data."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from vrbench.config.rig import load_rig
from vrbench.config.suite import Suite, load_suite
from vrbench.evaluation import evaluate
from vrbench.plugin.manager import Plugins, families_of
from vrbench.protocols.vrbench_1 import PROTOCOL
from vrbench.recording.monitor import Progress
from vrbench.results.bundle import Bundle
from vrbench.runner import record_suite

SHORT = """
suite: short
version: 1
title: One mount, two short repeats
motions: {head: saturate-30s-1, calibration: saturate-30s-1}
cases:
  - {id: calibrate, motion: calibration, role: calibration}
  - {id: replay, motion: head, repeats: 2, needs: [x, clock, y], anchor: 5 s}
metrics: [ape, rpe, scale, coverage, timing, clock, replay, handeye, repeatability]
gate: {handeye.translation: 15 mm, handeye.rotation: 0.5 deg, max_age: 60 min, bracket: 10 mm}
rank: {metric: ape.translation.aligned, point: eye, statistic: rmse, min_coverage: 95 %}
"""


class Quiet:
    """A watcher that nothing is told to."""

    def take(self, name: str, index: int, total: int) -> None:
        pass

    def moving(self, progress: Progress) -> None:
        pass

    def notice(self, text: str) -> None:
        pass


def evaluated(bundle: Bundle):
    """The rows of a bundle, by its own suite."""
    families = families_of(bundle.record.resolved_suite(), Plugins(), None)
    return evaluate(bundle, families, PROTOCOL, lambda *_: None)


def recorded(suite: Suite, folder: Path, rig: str = "sim:sim", seed: int = 7) -> Bundle:
    """A run of a suite on a simulated rig."""
    return record_suite(suite, load_rig(rig), rig, folder, Plugins(), seed=seed, watcher=Quiet())


@pytest.fixture(scope="session")
def short_suite_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("suites") / "short.yaml"
    path.write_text(SHORT)
    return path


@pytest.fixture(scope="session")
def short_suite(short_suite_path: Path) -> Suite:
    return load_suite(str(short_suite_path))


@pytest.fixture(scope="session")
def _run(tmp_path_factory: pytest.TempPathFactory, short_suite: Suite) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "sim"
    evaluated(recorded(short_suite, folder))
    return folder


@pytest.fixture
def run(_run: Path, tmp_path: Path) -> Path:
    """A complete, evaluated run, that a test may change."""
    folder = tmp_path / "run"
    shutil.copytree(_run, folder)
    return folder


@pytest.fixture(scope="session")
def paper() -> Path:
    """The recordings of the paper."""
    root = os.environ.get("VRBENCH_DATA")
    if not root or not (Path(root) / "banaszczyk2024").is_dir():
        pytest.skip("set VRBENCH_DATA to the folder that holds banaszczyk2024/")
    return Path(root) / "banaszczyk2024"
