"""Leaderboards as text: the numbers are those of plain arithmetic, and names stay names."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from tests.results.made_up import made_up
from vrbench.results.board import Leaderboard
from vrbench.results.board_formats import as_csv, as_json, as_latex, as_markdown
from vrbench.results.leaderboard import leaderboard

HOSTILE = "<script>alert(1)</script>|`x`_y_\\input{/etc/passwd}&%$#~^{}\"'\x1b[31m 頭 éŁő"


@pytest.fixture
def found(tmp_path: Path) -> Leaderboard:
    rng = np.random.default_rng(3)
    folders = [
        made_up(tmp_path / "a", device="a", error=2.0, rng=rng),
        made_up(tmp_path / "b", device="b", error=3.5, rng=rng, lab="=1+1", repeats=1),
        made_up(tmp_path / "c", device="c", error=5.0, rng=rng, firmware=HOSTILE),
        made_up(tmp_path / "d", device=HOSTILE, error=6.0, rng=rng),
    ]
    return leaderboard(folders, "vrbench-1")


def test_the_table_is_that_of_a_spreadsheet(found: Leaderboard) -> None:
    """Every number again, from the bundles' files by csv and arithmetic alone."""
    lines = list(csv.DictReader(StringIO(as_csv(found))))
    assert len(lines) == 4
    for line in lines:
        with (Path(line["runs"]) / "metrics/vrbench-1.csv").open(newline="") as file:
            rows = [row for row in csv.DictReader(file) if row["repeat"] != "all"]

        def of(metric: str, statistic: str, rows: list[dict[str, str]] = rows) -> list[float]:
            return [
                float(row["value"])
                for row in rows
                if (row["metric"], row["statistic"]) == (metric, statistic)
                and row["point"] in ("eye", "")
            ]

        # takes have as many samples each
        square = [v * v for v in of("ape.translation.aligned", "rmse")]
        mean = sum(of("ape.translation.aligned", "mean")) / len(square)
        rmse = (sum(square) / len(square)) ** 0.5
        assert float(line["value"]) == pytest.approx(rmse, rel=1e-8)
        assert float(line["rmse"]) == pytest.approx(rmse, rel=1e-8)
        assert float(line["mean"]) == pytest.approx(mean, rel=1e-8)
        assert float(line["std"]) == pytest.approx((rmse**2 - mean**2) ** 0.5, rel=1e-7)
        assert float(line["max"]) == pytest.approx(max(of("ape.translation.aligned", "max")))
        assert float(line["coverage"]) == min(of("coverage.valid", "value"))
        assert float(line["floor"]) == max(of("floor.total", "value"))
        assert int(line["takes"]) == len(square)
        assert int(line["mounts"]) == len({row["mount"] for row in rows})
    ranked = sorted((float(x["value"]), x["rank"]) for x in lines if x["rank"])
    assert [rank for _, rank in ranked] == ["1", "2", "3"]


def test_csv_holds_no_formula(found: Leaderboard) -> None:
    cells = [cell for line in csv.reader(StringIO(as_csv(found))) for cell in line]
    assert "'=1+1" in cells
    assert not [cell for cell in cells if cell.startswith(("=", "+", "@"))]


def test_json_holds_all_that_the_board_knows(found: Leaderboard) -> None:
    content = json.loads(as_json(found))
    (board,) = content["boards"]
    assert [entry["places"] for entry in board["entries"]] == ["1", "2", "3", "-"]
    assert board["entries"][2]["device"] == HOSTILE
    assert board["key"]["protocol"] == "vrbench-1"


def test_markdown_shows_names_as_they_are_and_runs_nothing(found: Leaderboard) -> None:
    text = as_markdown(found)
    assert "<script" not in text
    assert "&lt;script&gt;" in text
    assert "\x1b" not in text
    table = [line for line in text.splitlines() if line.startswith("| ")]
    widths = {len(re.findall(r"(?<!\\)\|", line)) for line in table}
    assert len(table) == 6
    assert len(widths) == 1


def test_latex_leaves_no_character_that_tex_obeys(found: Leaderboard) -> None:
    text = as_latex(found)
    known = r"\\(begin|end)\{(table|tabular)\}(\{rlr+\})?|\\(centering|hline|caption|,)"
    rest = re.sub(known + r"|\\text[a-z]+\{\}|\\[{}$&#_%]|\\\\", "", text)
    assert not re.search(r"[\\$#_~^%\"<>|]", rest)
    assert rest.count("{") == rest.count("}") == 1  # the caption's
    assert "頭" not in text


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="there is no TeX here")
def test_latex_compiles(found: Leaderboard, tmp_path: Path) -> None:
    (tmp_path / "board.tex").write_text(
        "\\documentclass{article}\n\\begin{document}\n" + as_latex(found) + "\\end{document}\n",
        encoding="utf-8",
    )
    done = subprocess.run(
        ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "board.tex"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stdout[-2000:]
    assert (tmp_path / "board.pdf").stat().st_size > 1000
