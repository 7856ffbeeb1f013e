"""Rows found by their key: the same as reading the whole table gives."""

from pathlib import Path

import numpy as np
import pytest

from tests.results.made_up import made_up
from vrbench.errors import DataError
from vrbench.results.bundle import Bundle
from vrbench.results.phases import read_phases
from vrbench.results.selection import MetricTable, select_bins
from vrbench.results.tables import read_rows

METRIC = "ape.translation.aligned"
BINS = {"reference": "robot", "metric": METRIC, "point": "eye"}


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Its device's name has what a CSV file quotes."""
    device = 'a "best", robot,main,'
    return made_up(tmp_path / "run", rng=np.random.default_rng(2), device=device)


def test_every_row_is_found_by_its_key(run: Path) -> None:
    path = run / "metrics/vrbench-1.csv"
    table = MetricTable(path, path.read_bytes())
    rows = read_rows(path)
    # also backwards, where the next isn't below the last
    for row in (*rows, *reversed(rows)):
        take, number = row.key[3:5] + row.key[6:8], row.key[8:]
        assert table.row(take, number) == row
    assert table.row(("replay", "two", "1", "1"), rows[0].key[8:]) is None
    assert table.row(("replay", "default", "1", "1"), ("all", "mocap", *rows[0].key[10:])) is None


def test_bins_are_those_of_the_table(run: Path) -> None:
    path = run / "metrics/vrbench-1.phase.csv"
    takes = Bundle.open(run).record.takes
    elsewhere = takes[0].model_copy(update={"mount": 9})
    found = select_bins(path, path.read_bytes(), [takes[3], elsewhere, takes[0]], **BINS)
    assert list(found) == [(2, 1), (1, 1)]
    for (mount, repeat), (number, square) in found.items():
        rows = [
            row
            for row in read_phases(path)
            if (row.mount, row.repeat, row.metric, row.point) == (mount, repeat, METRIC, "eye")
        ]
        assert number.tolist() == [row.phase for row in rows]
        assert square.tolist() == [row.mean_square for row in rows]
    assert select_bins(path, path.read_bytes(), [elsewhere], **BINS) == {}


@pytest.mark.parametrize(
    ("cells", "told"),
    [
        ("1,2.0,many,mm", "could not convert string 'many'"),
        ("1,2.0", "invalid column index"),
        ("0,2.0,4.0,mm", "don't follow each other"),
        ("1,2.0,-4.0,mm", "not negative"),
        ("1,2.0,nan,mm", "not negative"),
    ],
)
def test_bins_that_no_evaluation_writes_are_refused(run: Path, cells: str, told: str) -> None:
    path = run / "metrics/vrbench-1.phase.csv"
    lines = path.read_text().splitlines()
    lines[2] = ",".join([*lines[2].split(",")[:7], cells])
    text = "\n".join(lines).encode()
    with pytest.raises(DataError, match=told):
        select_bins(path, text, Bundle.open(run).record.takes, **BINS)
