"""Leaderboards: only what can be compared stands together, only what may be ranked has a rank."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from vrbench.errors import ConfigError, DataError
from vrbench.results.bundle import Bundle
from vrbench.results.leaderboard import leaderboard
from vrbench.results.tables import read_rows, write_rows

TABLE = "metrics/vrbench-1.csv"


@pytest.fixture
def run(run: Path) -> Path:
    """A run whose intervals speak for more than its takes, as those of more mounts would."""
    rows = [replace(r, ci_scope="mount" if r.ci_scope else "") for r in read_rows(run / TABLE)]
    write_rows(rows, run / TABLE)
    return run


@pytest.fixture
def rival(run: Path, tmp_path: Path) -> Path:
    """A second run, of a device that errs twice as much."""
    folder = tmp_path / "rival"
    shutil.copytree(run, folder)
    edit(folder, lambda record: record["device"].update(headset="rival"))
    lines = (folder / TABLE).read_text().splitlines()
    header = lines[0].split(",")
    value, metric = header.index("value"), header.index("metric")
    out = [lines[0]]
    for line in lines[1:]:
        cells = line.split(",")
        if cells[metric].startswith("ape.translation") and cells[value]:
            cells[value] = str(2 * float(cells[value]))
        out.append(",".join(cells))
    (folder / TABLE).write_text("\n".join(out) + "\n")
    return folder


def entered(folder: Path) -> None:
    """Lets the record know of a table that the test has changed."""
    Bundle.open(folder).enter(TABLE)


def edit(folder: Path, change) -> None:
    path = folder / "run.json"
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))


def boards(*folders: Path):
    for folder in folders:
        if (folder / TABLE).is_file():
            entered(folder)
    return leaderboard([Bundle.open(folder) for folder in folders], "vrbench-1")


def test_the_smaller_error_ranks_first(run: Path, rival: Path) -> None:
    (board,) = boards(rival, run)
    assert [entry.device for entry in board.entries] == ["sim", "rival"]
    assert [entry.rank for entry in board.entries] == [1, 2]
    assert board.entries[1].value == pytest.approx(2 * board.entries[0].value)
    assert (board.entries[0].takes, board.entries[0].mounts) == (2, 1)
    assert board.metric == "ape.translation.aligned rmse at the eye"


@pytest.mark.parametrize(
    "change",
    [
        lambda record: record.update(suite_digest="0" * 64),
        lambda record: [t.update(motion_digest="0" * 64) for t in record["takes"]],
        lambda record: [t.update(speed=1.24) for t in record["takes"]],
        lambda record: [t.update(stretch=2.0) for t in record["takes"]],
        lambda record: record.update(kind="recorded"),
    ],
)
def test_what_differs_in_suite_motion_or_speed_stands_apart(run: Path, rival: Path, change) -> None:
    edit(rival, change)
    found = boards(run, rival)
    assert len(found) == 2
    assert [len(board.entries) for board in found] == [1, 1]


def test_a_bad_calibration_is_listed_unranked_with_its_reason(run: Path, rival: Path) -> None:
    text = (rival / TABLE).read_text()
    (rival / TABLE).write_text(text.replace(",ok,", ",unbracketed,no calibration after"))
    (board,) = boards(run, rival)
    assert [entry.rank for entry in board.entries] == [1, None]
    assert board.entries[1].status == "unbracketed"
    assert board.entries[1].reason == "no calibration after"
    assert board.entries[1].value is not None


def test_a_motion_done_in_part_is_listed_unranked(run: Path) -> None:
    edit(run, lambda record: record["takes"][1].update(fraction=0.6))
    (board,) = boards(run)
    assert (board.entries[0].rank, board.entries[0].status) == (None, "not completed")
    assert board.entries[0].reason == "the robot did 60 % of the motion"


def test_takes_that_recentred_are_listed_unranked(run: Path) -> None:
    rows = [
        replace(row, value=2.0) if row.metric == "coverage.epochs" else row
        for row in read_rows(run / TABLE)
    ]
    write_rows(rows, run / TABLE)
    (board,) = boards(run)
    assert (board.entries[0].rank, board.entries[0].epochs) == (None, 2)
    assert board.entries[0].status == "recentred"


def test_one_mount_or_too_few_repeats_have_no_rank(run: Path) -> None:
    rows = [replace(r, ci_scope="take" if r.ci_scope else "") for r in read_rows(run / TABLE)]
    write_rows(rows, run / TABLE)
    (board,) = boards(run)
    assert (board.entries[0].rank, board.entries[0].status) == (None, "take scope")
    assert board.entries[0].value is not None


def test_a_take_that_failed_leaves_no_number_to_rank(run: Path) -> None:
    text = (run / TABLE).read_text()
    lines = [
        re.sub(r",ok,$", ",failed,no overlap", line)
        if line.startswith("vrbench-1,sim,short@1,replay,default,1,1,2,")
        else line
        for line in text.splitlines()
    ]
    (run / TABLE).write_text("\n".join(lines) + "\n")
    (board,) = boards(run)
    assert (board.entries[0].rank, board.entries[0].value) == (None, None)
    assert board.entries[0].status == "failed"


def test_low_coverage_is_listed_unranked(run: Path) -> None:
    rows = [
        replace(row, value=94.9) if row.metric == "coverage.valid" else row
        for row in read_rows(run / TABLE)
    ]
    write_rows(rows, run / TABLE)
    (board,) = boards(run)
    assert board.entries[0].status == "low coverage"
    assert board.entries[0].rank is None
    assert "95% valid poses" in board.entries[0].reason


def test_the_same_run_twice_is_refused(run: Path) -> None:
    with pytest.raises(ConfigError, match="given twice"):
        boards(run, run)


def test_a_table_that_was_changed_is_refused(run: Path) -> None:
    entered(run)
    path = run / TABLE
    path.write_text("\n".join(path.read_text().splitlines()[:-3]) + "\n")
    with pytest.raises(DataError, match="was changed since it was written"):
        leaderboard([Bundle.open(run)], "vrbench-1")


def test_a_run_without_metrics_says_what_to_do(run: Path) -> None:
    (run / TABLE).unlink()
    with pytest.raises(DataError, match="vrbench evaluate"):
        boards(run)
