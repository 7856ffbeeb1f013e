"""The intervals of a run: of each take, of all together, and of conditions against the baseline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vrbench.config.suite import Suite
from vrbench.results.board import FLOORED
from vrbench.results.report.run_tables import Numbers, Place, Result, ranking, suite_order
from vrbench.results.tables import Row


def forests(
    results: Mapping[str, Sequence[Result]], numbers: Mapping[Place, Numbers], suite: Suite
) -> list[dict[str, Any]]:
    """The ranking number of each take and of all together, with intervals, by reference."""
    charts = []
    for reference, lines in results.items():
        shown = [
            line for line in lines if line.ranked is not None and line.ranked.value is not None
        ]
        if not shown:
            continue
        unit = shown[0].ranked.unit if shown[0].ranked else ""
        several = f", by {reference}" if len(results) > 1 else ""
        charts.append(
            {
                "title": f"The ranking number by take{several}",
                "note": f"{suite.rank.metric}; {_intervals(shown)}; hollow where not ok",
                "label": ranking(suite),
                "unit": unit,
                "rows": [_point(line, _floor(line, lines, numbers, suite)) for line in shown[:200]],
            }
        )
    return charts


def _intervals(lines: Sequence[Result]) -> str:
    known = any(line.ranked is not None and line.ranked.ci_low is not None for line in lines)
    return "intervals of 95 %" if known else "no intervals are computed of it"


def _floor(
    line: Result, lines: Sequence[Result], numbers: Mapping[Place, Numbers], suite: Suite
) -> float | None:
    """The noise floor of a take; of takes together the largest of theirs, as on a leaderboard."""
    if not suite.rank.metric.startswith(FLOORED):
        return None
    of = [line]
    if line.pooled:
        of = [one for one in lines if not one.pooled and one.place[:3] == line.place[:3]]
    key = ("floor.total", suite.rank.point, "value")
    rows = [numbers[one.place].get(key) for one in of]
    known = [row.value for row in rows if row is not None and row.value is not None]
    return max(known) if known and len(known) == len(of) else None


def _point(line: Result, floor: float | None) -> dict[str, Any]:
    row = line.ranked
    assert row is not None
    return {
        "name": line.name,
        "pooled": line.pooled,
        "status": line.status,
        "value": row.value,
        "low": row.ci_low,
        "high": row.ci_high,
        "floor": floor,
    }


def changes(rows: Sequence[Row], suite: Suite) -> list[Row]:
    """The ranking number of each condition minus that of the baseline, where there is one."""
    rank = suite.rank
    wanted = ("vs-baseline", rank.metric, rank.point, rank.statistic, "all", "all")
    found = [
        row
        for row in rows
        if (row.variant, row.metric, row.point, row.statistic, row.band, row.segment) == wanted
        and row.value is not None
    ]
    return sorted(found, key=lambda row: suite_order(suite, row.case, row.condition))


def forest_of_changes(found: Sequence[Row], suite: Suite) -> list[dict[str, Any]]:
    """One chart of the changes, by reference."""
    charts = []
    for reference in dict.fromkeys(row.reference for row in found):
        lines = [row for row in found if row.reference == reference]
        several = f", by {reference}" if len({row.reference for row in found}) > 1 else ""
        charts.append(
            {
                "title": f"Change against the baseline{several}",
                "note": f"{suite.rank.metric}, paired by phase; hollow where 95 % hold nought",
                "label": f"change of the {ranking(suite)}",
                "unit": lines[0].unit,
                "rows": [
                    {
                        "name": f"{row.case} {row.condition} - {suite.baseline}",
                        "pooled": False,
                        "status": "ok" if separate(row) else "not separable",
                        "value": row.value,
                        "low": row.ci_low,
                        "high": row.ci_high,
                        "floor": None,
                    }
                    for row in lines
                ],
            }
        )
    return charts


def separate(row: Row) -> bool:
    """Whether a change's interval leaves out nought."""
    return row.ci_low is not None and row.ci_high is not None and row.ci_low * row.ci_high > 0.0
