"""Leaderboards: only what can be compared stands together, only what may be ranked has a rank."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.results.made_up import SUITE, made_up
from vrbench.errors import ConfigError
from vrbench.results.board import Board, Entry, notes
from vrbench.results.bundle import Bundle
from vrbench.results.leaderboard import leaderboard
from vrbench.results.record import OcclusionRecord
from vrbench.results.tables import Row, read_rows, write_rows

TABLE = "metrics/vrbench-1.csv"
Make = Callable[..., Path]


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Makes bundles of one lab's devices, all with one seed for chance."""
    rng = np.random.default_rng(5)

    def one(name: str, **facts: Any) -> Path:
        return made_up(tmp_path / name, rng=rng, **{"device": name, **facts})

    return one


def boards(*folders: Path) -> list[Board]:
    found = leaderboard(folders, "vrbench-1")
    assert not found.left_out
    return list(found.boards)


def only(*folders: Path) -> list[Entry]:
    (board,) = boards(*folders)
    return list(board.entries)


def edit(folder: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    path = folder / "run.json"
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))
    return folder


def rewrite(folder: Path, change: Callable[[Row], Row]) -> Path:
    """Changes rows as another evaluation would have, so that the record knows of it."""
    write_rows([change(row) for row in read_rows(folder / TABLE)], folder / TABLE)
    Bundle.open(folder).enter(TABLE)
    return folder


def one(metric: str, **cells: Any) -> Callable[[Row], Row]:
    """Changes the first take's row of a metric."""
    return lambda row: (
        replace(row, **cells)
        if (row.metric, row.mount, row.repeat, row.point) == (metric, "1", "1", "eye")
        and row.statistic in ("rmse", "value")
        else row
    )


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (one("ape.translation.aligned", value=-5.0), "rmse is -5, which can't be negative"),
        (one("floor.total", value=-1.0), "floor.total value is -1, which can't be negative"),
        (one("ape.translation.aligned", unit="%", value=101.0), "is 101 %"),
        (one("ape.translation.aligned", samples=-1), "samples is -1"),
        (one("ape.translation.aligned", status="great"), "status is 'great', none of"),
        (one("ape.translation.aligned", ci_low=1.0), "the interval 1.0 to None is none"),
        (
            one("ape.translation.aligned", ci_low=2.0, ci_high=1.0, ci_scope="mount"),
            "the interval 2.0 to 1.0 is none",
        ),
        (one("ape.translation.aligned", ci_low=1.0, ci_high=9.0), "ci_scope is ''"),
    ],
)
def test_what_no_evaluation_writes_stands_on_no_board(make: Make, change: Any, told: str) -> None:
    """Its digest fits: who changed it entered it anew."""
    sound, wrong = make("a"), rewrite(make("b"), change)
    found = leaderboard([sound, wrong], "vrbench-1")
    (left,) = found.left_out
    assert left.run == str(wrong)
    assert told in str(left.error)
    assert [entry.device for board in found.boards for entry in board.entries] == ["a"]


def test_the_floor_stands_beside_what_it_is_the_floor_of(make: Make) -> None:
    """That of translation [mm] says nothing of what trembles, or turns [deg]."""

    def turned(row: Row) -> Row:
        ranked = row.metric == "ape.translation.aligned"
        return replace(row, metric="ape.rotation.aligned", unit="deg") if ranked else row

    suite = {**SUITE, "rank": {"metric": "ape.rotation.aligned"}}
    entries = only(rewrite(make("a", suite=suite), turned))
    assert entries[0].value is not None
    assert entries[0].floor is None


def test_the_smaller_error_ranks_first(make: Make) -> None:
    (board,) = boards(make("worse", error=4.0), make("better", error=2.0))
    assert [entry.device for entry in board.entries] == ["better", "worse"]
    assert [entry.places for entry in board.entries] == ["1", "2"]
    best = board.entries[0]
    assert best.value == pytest.approx(2.0, rel=0.1)
    assert (best.takes, best.mounts, best.sittings, best.scope) == (6, 2, 1, "mount")
    assert (best.coverage, best.epochs, best.floor) == (99.5, 1, 0.05)
    assert board.metric == "ape.translation.aligned rmse at the eye"
    assert list(best.statistics) == ["rmse", "mean", "std", "max"]


def test_devices_that_cannot_be_told_apart_share_places(make: Make) -> None:
    entries = only(make("a", error=2.0), make("b", error=2.02), make("c", error=4.0))
    assert {entry.device: entry.places for entry in entries} == {"a": "1-2", "b": "1-2", "c": "3"}


def test_errors_below_the_noise_floor_are_not_told_apart(make: Make) -> None:
    entries = only(make("a", error=2.0, floor=5.0), make("b", error=4.0, floor=5.0))
    assert [entry.places for entry in entries] == ["1-2", "1-2"]


@pytest.mark.parametrize(
    "change",
    [
        {"suite": {**SUITE, "version": 2}},
        {"suite": {**SUITE, "gate": {"bracket": 0.002}}},
        {"kind": "simulated"},
    ],
)
def test_what_differs_in_suite_or_kind_stands_apart(make: Make, change: dict[str, Any]) -> None:
    found = boards(make("a"), make("b", **change))
    assert [len(board.entries) for board in found] == [1, 1]


@pytest.mark.parametrize("change", [{"motion_digest": "0" * 64}, {"speed": 1.24}, {"stretch": 2.0}])
def test_what_differs_in_motion_or_speed_stands_apart(make: Make, change: dict[str, Any]) -> None:
    other = edit(make("b"), lambda record: [take.update(change) for take in record["takes"]])
    assert [len(board.entries) for board in boards(make("a"), other)] == [1, 1]


@pytest.mark.parametrize(
    "facts",
    [
        {"firmware": "2"},
        {"logger": "other"},
        {"logger_version": "2"},
        {"prediction": "off"},
        {"lab": "lab-2"},
    ],
)
def test_what_makes_a_device_another_has_a_row_of_its_own(
    make: Make, facts: dict[str, str]
) -> None:
    entries = only(make("a", device="same"), make("b", device="same", **facts))
    assert [entry.status for entry in entries] == ["ok", "ok"]
    assert len({(*entry.identity, entry.lab) for entry in entries}) == 2


def test_a_bad_calibration_is_listed_unranked_with_its_reason(make: Make) -> None:
    bad = rewrite(
        make("b"), lambda row: replace(row, status="unbracketed", reason="no calibration after")
    )
    first, second = only(make("a"), bad)
    assert (first.places, second.places) == ("1", "-")
    assert (second.status, second.reason) == ("unbracketed", "no calibration after")
    assert second.value is not None


def test_takes_that_fail_or_are_invalid_are_counted_and_leave_no_number(make: Make) -> None:
    def spoil(row: Row) -> Row:
        status = {("1", "2"): "failed", ("2", "1"): "invalid"}.get((row.mount, row.repeat))
        if row.repeat == "all" and row.mount == "all":
            return replace(row, value=None, ci_low=None, ci_high=None, status="failed")
        return row if status is None else replace(row, value=None, status=status, reason="why")

    (entry,) = only(rewrite(make("a"), spoil))
    assert (entry.places, entry.value, entry.status) == ("-", None, "failed")
    assert (entry.failed, entry.invalid) == (1, 1)


@pytest.mark.parametrize(
    ("facts", "status", "told"),
    [
        ({"coverage": 94.9}, "low coverage", "95% valid poses"),
        ({"epochs": 2}, "recentred", "aligned apart"),
        ({"mounts": 1}, "take scope", "two mounts of three repeats"),
        ({"repeats": 2}, "take scope", "two mounts of three repeats"),
    ],
)
def test_what_may_not_be_ranked_is_listed_and_says_why(
    make: Make, facts: dict[str, Any], status: str, told: str
) -> None:
    (entry,) = only(make("a", **facts))
    assert (entry.places, entry.status) == ("-", status)
    assert told in entry.reason
    assert entry.value is not None


def test_a_motion_done_in_part_is_listed_unranked(make: Make) -> None:
    part = edit(make("a"), lambda record: record["takes"][1].update(fraction=0.6))
    (entry,) = only(part)
    assert (entry.places, entry.status) == ("-", "not completed")
    assert entry.reason == "the robot did 60 % of the motion"


def test_a_floor_that_one_take_lacks_is_not_stated(make: Make) -> None:
    (entry,) = only(make("a", floor=None))
    assert entry.floor is None


def test_sittings_of_one_device_are_one_row(make: Make) -> None:
    first = make("s1", device="a", sitting="1", mounts=1)
    second = make("s2", device="a", sitting="2", mounts=1)
    (entry,) = only(first, second)
    assert (entry.takes, entry.mounts, entry.sittings, entry.scope) == (6, 2, 2, "sitting")
    rows = [row for folder in (first, second) for row in read_rows(folder / TABLE)]
    single = [
        row
        for row in rows
        if (row.metric, row.point, row.statistic) == ("ape.translation.aligned", "eye", "rmse")
        and row.repeat != "all"
    ]
    assert len(single) == 6
    assert entry.value == pytest.approx(np.sqrt(np.mean([row.value**2 for row in single])))
    assert entry.statistics["rmse"] == pytest.approx(entry.value)
    assert entry.low is not None and entry.low < entry.value < entry.high


def test_a_second_run_of_one_sitting_is_listed_never_averaged(make: Make) -> None:
    first = make("one", device="a", created="2026-01-01T00:00:00+00:00")
    second = make("two", device="a", created="2026-01-02T00:00:00+00:00")
    ranked, listed = only(second, first)
    assert (ranked.runs, ranked.places) == ([str(first)], "1")
    assert (listed.runs, listed.places, listed.status) == ([str(second)], "-", "duplicate")
    alone = only(first)[0]
    assert ranked.value == alone.value


def test_a_copy_of_a_run_is_a_duplicate(make: Make, tmp_path: Path) -> None:
    first = make("a")
    shutil.copytree(first, tmp_path / "copy")
    ranked, copy = only(first, edit(tmp_path / "copy", lambda r: r.update(sitting="2")))
    assert (ranked.places, copy.places, copy.status) == ("1", "-", "duplicate")
    assert "holds recordings of" in copy.reason


def test_recordings_under_another_name_are_told_of(make: Make, tmp_path: Path) -> None:
    first = make("a")
    shutil.copytree(first, tmp_path / "b")
    other = edit(tmp_path / "b", lambda record: record["device"].update(headset="b"))
    entries = only(first, other)
    assert [entry.places for entry in entries] == ["1-2", "1-2"]
    assert all("the same recordings" in entry.reason for entry in entries)


def test_labs_are_ranked_apart(make: Make) -> None:
    (board,) = boards(
        make("a", error=2.0),
        make("b", error=4.0),
        make("c", error=1.0, lab="lab-2"),
        make("d", error=3.0, lab="lab-2"),
    )
    places = {entry.device: (entry.places, entry.ranked_among) for entry in board.entries}
    assert places == {
        "a": ("1", ("lab-1",)),
        "b": ("2", ("lab-1",)),
        "c": ("1", ("lab-2",)),
        "d": ("2", ("lab-2",)),
    }
    assert any("ranked apart" in note for note in notes(board))


def test_labs_with_a_reference_device_are_ranked_together(make: Make) -> None:
    entries = only(
        make("a", error=1.0),
        make("r1", device="reference", error=3.0),
        make("r2", device="reference", error=3.0, lab="lab-2"),
        make("b", error=9.0, lab="lab-2"),
    )
    assert [entry.places for entry in entries] == ["1", "2-3", "2-3", "4"]
    assert {entry.ranked_among for entry in entries} == {("lab-1", "lab-2")}


def test_labs_that_differ_on_their_reference_device_are_told(make: Make) -> None:
    (board,) = boards(
        make("r1", device="reference", error=2.0),
        make("r2", device="reference", error=5.0, lab="lab-2"),
        make("b", error=9.0, lab="lab-2"),
    )
    assert [entry.places for entry in board.entries] == ["1", "2", "3"]
    first, second = (entry.reason for entry in board.entries[:2])
    assert re.search(r"other labs found otherwise: lab-2 \([45]\.", first)
    assert re.search(r"other labs found otherwise: lab-1 \([12]\.", second)
    assert not board.entries[2].reason


OCCLUDED = {
    **SUITE,
    "suite": "occluded-cameras",
    "conditions": [{"id": "none", "baseline": True}, {"id": "two", "occlude": "two"}],
    "compare": "paired",
}


def test_occlusion_is_ranked_by_the_change_against_each_device_s_own_baseline(make: Make) -> None:
    """The headset that is bad in any case isn't the one that suffers most."""
    cameras = OcclusionRecord(cameras=dict.fromkeys(range(5), "camera"), levels={"two": [0, 3]})
    facts = {"suite": OCCLUDED, "occlusion": cameras}
    plain, covered = boards(
        make("steady", error={"none": 5.0, "two": 5.5}, **facts),
        make("shaken", error={"none": 1.0, "two": 4.0}, **facts),
    )
    assert (plain.key.condition, plain.change) == ("none", False)
    measured = [e for e in plain.entries if e.source == "measured"]
    assert [(e.device, e.places, e.cameras) for e in measured] == [
        ("shaken", "1", (0, 5)),
        ("steady", "2", (0, 5)),
    ]
    assert (covered.key.condition, covered.change) == ("two", True)
    assert covered.metric.endswith("against none")
    measured = [e for e in covered.entries if e.source == "measured"]
    assert [(e.device, e.places, e.cameras) for e in measured] == [
        ("steady", "1", (2, 5)),
        ("shaken", "2", (2, 5)),
    ]
    assert measured[1].value == pytest.approx(3.0, rel=0.15)
    assert measured[1].statistics["rmse"] == pytest.approx(4.0, rel=0.15)
    (printed,) = (e for e in covered.entries if e.source == "published")
    assert printed.value == pytest.approx(6.08 - 3.05)


def test_a_change_that_was_not_computed_is_said(make: Make) -> None:
    run = make("a", error={"none": 2.0, "two": 3.0}, suite=OCCLUDED)
    rows = [row for row in read_rows(run / TABLE) if row.variant == "main"]
    write_rows(rows, run / TABLE)
    Bundle.open(run).enter(TABLE)
    entry = boards(run)[1].entries[0]
    assert (entry.status, entry.reason) == (
        "failed",
        "the change against the baseline was not computed",
    )


def test_a_run_whose_takes_are_missing_is_listed_unranked(make: Make) -> None:
    run = make("a")
    next((run / "takes").iterdir()).unlink()
    (entry,) = only(run)
    assert (entry.status, entry.places) == ("takes missing", "-")
    assert entry.reason == "1 of its takes aren't there to be evaluated again"


@pytest.mark.parametrize("name", ["run.json", TABLE])
def test_a_pipe_in_place_of_a_file_is_left_out(make: Make, name: str) -> None:
    run = make("a")
    (run / name).unlink()
    os.mkfifo(run / name)
    found = leaderboard([run, make("b")], "vrbench-1")
    assert [left_out.run for left_out in found.left_out] == [str(run)]
    assert "is no file" in str(found.left_out[0].error)


def test_the_same_run_twice_is_refused(make: Make) -> None:
    run = make("a")
    with pytest.raises(ConfigError, match="given twice"):
        leaderboard([run, run], "vrbench-1")


def test_a_run_that_cannot_be_read_is_left_out_and_told(make: Make, tmp_path: Path) -> None:
    good, changed, unevaluated = make("a"), make("b"), make("c")
    table = changed / TABLE
    table.write_text(table.read_text().replace(",2.", ",1."))
    (unevaluated / TABLE).unlink()
    newer = edit(make("d"), lambda record: record.update(schema_version=2))
    forged = edit(make("e"), lambda record: record["suite"].update(metrics=["ape", "rpe"]))
    outside = make("f")
    shutil.copy(outside / TABLE, tmp_path / "elsewhere.csv")
    (outside / TABLE).unlink()
    (outside / TABLE).symlink_to(tmp_path / "elsewhere.csv")
    broken = [changed, unevaluated, newer, forged, outside, tmp_path / "nothing"]
    found = leaderboard([good, *broken], "vrbench-1")
    assert [entry.device for board in found.boards for entry in board.entries] == ["a"]
    told = {left.run: str(left.error) for left in found.left_out}
    for run, why in zip(
        broken,
        (
            "was changed since it was written",
            "vrbench evaluate RUN",
            "reads version 1",
            "suite's digest",
            "leads out of the bundle",
            "is not a run",
        ),
        strict=True,
    ):
        assert why in told[str(run)]


def test_a_protocol_that_does_not_give_what_is_ranked_is_told(make: Make) -> None:
    run = rewrite(make("a"), lambda row: replace(row, point="tcp" if row.point else ""))
    (left,) = leaderboard([run], "vrbench-1").left_out
    assert "protocol vrbench-1 gives no ape.translation.aligned at the eye" in str(left.error)
