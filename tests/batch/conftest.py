"""Runs for those who evaluate many."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from vrbench.results.bundle import Bundle


@pytest.fixture
def two(run: Path) -> tuple[Path, Path]:
    """A run, and a copy that was never evaluated, in one folder whose name has a space in it."""
    folder = run.parent / "two runs"
    folder.mkdir()
    for name in ("a", "b"):
        shutil.copytree(run, folder / name)
    bundle = Bundle.open(folder / "b")
    shutil.rmtree(folder / "b" / "metrics")
    (folder / "b" / "calibration.json").unlink()
    bundle.record.files = {n: d for n, d in bundle.record.files.items() if n.endswith(".yaml")}
    bundle.finish()
    return folder / "a", folder / "b"
