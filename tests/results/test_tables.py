"""Metric tables: exact, strict, and pooled by samples."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vrbench.errors import DataError
from vrbench.results.tables import Row, pool, read_rows, write_rows

ROW = Row(
    protocol="vrbench-1",
    device="d",
    suite="s@1",
    case="replay",
    condition="default",
    sitting="1",
    mount="1",
    repeat="1",
    segment="all",
    reference="robot",
    variant="main",
    metric="ape.translation.aligned",
    point="eye",
    band="all",
    statistic="rmse",
    value=1.25,
    unit="mm",
    samples=10,
)

TAKES = ("mount", "repeat")
BOTH = {("1", "1"): "", ("1", "2"): ""}


@pytest.mark.parametrize("gap", ["\n", "\r\n", "\u2028", "\x85", "\x0b", "\x1c", "  "])
def test_a_reason_is_one_line_whatever_a_plugin_says(gap: str, tmp_path: Path) -> None:
    write_rows([replace(ROW, reason=f"first{gap}second")], tmp_path / "a.csv")
    (row,) = read_rows(tmp_path / "a.csv")
    assert row.reason == "first second"


def test_rows_come_back(tmp_path: Path) -> None:
    rows = [ROW, replace(ROW, value=None, status="skipped", reason='no "x", says the gate')]
    write_rows(rows, tmp_path / "metrics" / "a.csv")
    assert read_rows(tmp_path / "metrics" / "a.csv") == rows


def test_rows_without_quotes_come_back_too(tmp_path: Path) -> None:
    rows = [ROW, replace(ROW, value=None, status="skipped", reason="there is none", samples=0)]
    write_rows(rows, tmp_path / "a.csv")
    assert '"' not in (tmp_path / "a.csv").read_text()
    assert read_rows(tmp_path / "a.csv") == rows


def test_a_row_of_another_length_is_told_with_its_number(tmp_path: Path) -> None:
    write_rows([ROW, ROW], tmp_path / "a.csv")
    text = (tmp_path / "a.csv").read_text()
    (tmp_path / "a.csv").write_text(text.rstrip("\n") + ",more\n")
    with pytest.raises(DataError, match="row 3 has 24 cells"):
        read_rows(tmp_path / "a.csv")


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_number_that_is_none_is_never_written(tmp_path: Path, value: float) -> None:
    with pytest.raises(ValueError, match="rmse is"):
        write_rows([replace(ROW, value=value)], tmp_path / "a.csv")
    assert not (tmp_path / "a.csv").exists()


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n"])
def test_other_tables_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(DataError, match="other columns"):
        read_rows(tmp_path / "a.csv")


def test_a_broken_cell_is_told(tmp_path: Path) -> None:
    write_rows([ROW], tmp_path / "metrics" / "a.csv")
    path = tmp_path / "metrics" / "a.csv"
    path.write_text(path.read_text().replace("1.25", "much"))
    with pytest.raises(DataError, match="can't be read"):
        read_rows(path)


def of_errors(errors: np.ndarray, repeat: str) -> list[Row]:
    numbers = {
        "rmse": np.sqrt(np.mean(errors**2)),
        "mean": errors.mean(),
        "std": errors.std(),
        "min": errors.min(),
        "max": errors.max(),
        "sse": np.sum(errors**2),
    }
    return [
        replace(ROW, repeat=repeat, statistic=k, value=float(v), samples=len(errors))
        for k, v in numbers.items()
    ]


def test_pooled_numbers_are_those_of_all_samples_together() -> None:
    rng = np.random.default_rng(0)
    one, two = np.abs(rng.normal(size=50)), np.abs(rng.normal(2, 1, size=170))
    pooled = {
        row.statistic: row for row in pool(of_errors(one, "1") + of_errors(two, "2"), TAKES, BOTH)
    }
    expected = {row.statistic: row for row in of_errors(np.concatenate((one, two)), "all")}
    assert pooled.keys() == expected.keys()
    for name, row in pooled.items():
        assert row.value == pytest.approx(expected[name].value)
        assert (row.mount, row.repeat, row.samples) == ("all", "all", 220)


def test_one_take_is_not_pooled() -> None:
    assert pool(of_errors(np.ones(3), "1"), TAKES, {("1", "1"): ""}) == []


def test_a_take_without_a_number_leaves_none_for_all_and_is_named() -> None:
    rows = of_errors(np.ones(3), "1")
    rows.append(replace(ROW, repeat="2", value=None, status="failed", reason="x"))
    (row,) = pool(rows, TAKES, BOTH)
    assert (row.value, row.status, row.repeat) == (None, "failed", "all")
    assert row.reason == "mount 1 repeat 2: x"


def test_a_take_that_is_not_there_at_all_is_named_too() -> None:
    (row,) = pool(of_errors(np.ones(3), "1"), TAKES, {**BOTH, ("1", "2"): "no overlap"})
    assert (row.value, row.status) == (None, "failed")
    assert row.reason == "mount 1 repeat 2: no overlap"


def test_the_worst_status_is_the_pool_s() -> None:
    bad = [replace(r, status="extrapolated", reason="far") for r in of_errors(np.ones(3), "2")]
    assert {row.status for row in pool(of_errors(np.ones(3), "1") + bad, TAKES, BOTH)} == {
        "extrapolated"
    }
