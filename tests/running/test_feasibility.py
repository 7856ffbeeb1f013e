"""What a suite does in its takes fits into them, or is refused before anything is recorded."""

from __future__ import annotations

from pathlib import Path

import pytest

from vrbench.config.shipped import shipped_files
from vrbench.config.suite import load_suite
from vrbench.errors import ConfigError
from vrbench.running.feasibility import check_feasible

TEXT = """\
suite: nod
version: 1
title: A nod
motions: {{head: saturate-30s-1, opening: shooter-1}}
cases: [{{id: nod, motion: head, needs: [clock], {knobs}}}]
metrics: [clock]
rank: {{metric: clock.skew}}
"""


def rehearsed(folder: Path, knobs: str) -> None:
    path = folder / "nod.yaml"
    path.write_text(TEXT.format(knobs=knobs))
    check_feasible(load_suite(str(path)), "nod.yaml")


@pytest.mark.parametrize(
    ("knobs", "says"),
    [
        ("events: [{at: 30 s, do: recentre}]", r"event at 30 s, .*last run is over after 30 s"),
        ("speed: 2, events: [{at: 16 s, do: recentre}]", "over after 15 s"),
        ("duration: 2 min, events: [{at: 3 min, do: recentre}]", "at 180 s, .*over after 120 s"),
        ("speed: 10", r"nod takes 3 s at speed 10, and needs clock \(at least 5 s"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, knobs, says):
    with pytest.raises(ConfigError, match=says):
        rehearsed(tmp_path, knobs)


@pytest.mark.parametrize(
    "knobs",
    [
        "events: [{at: 29 s, do: recentre}]",
        "loops: 2, hold: 5 s, events: [{at: 64 s, do: recentre}]",
        "speed: 10, hold: 2 s",
    ],
)
def test_what_fits_is_let_pass(tmp_path, knobs):
    rehearsed(tmp_path, knobs)


@pytest.mark.parametrize("name", sorted(shipped_files("suites")))
def test_every_suite_that_comes_along_fits(name):
    check_feasible(load_suite(name), name)
