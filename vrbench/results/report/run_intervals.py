"""The intervals of a run: of each take, of all together, and of conditions against the baseline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vrbench.config.suite import Suite
from vrbench.results.report.run_tables import Numbers, Place, Result
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
        floors = [
            row.value
            for line in shown
            if (row := numbers[line.place].get(("floor.total", suite.rank.point, "value")))
            and row.value is not None
        ]
        unit = shown[0].ranked.unit if shown[0].ranked else ""
        several = f", by {reference}" if len(results) > 1 else ""
        charts.append(
            {
                "title": f"The ranking number by take{several}",
                "note": f"{suite.rank.metric}; intervals of 95 %; hollow where not ok",
                "label": f"{suite.rank.statistic} at the {suite.rank.point}",
                "unit": unit,
                "floor": max(floors) if floors and unit == "mm" else None,
                "rows": [_point(line) for line in shown[:200]],
            }
        )
    return charts


def _point(line: Result) -> dict[str, Any]:
    row = line.ranked
    assert row is not None
    return {
        "name": line.name,
        "pooled": line.pooled,
        "status": line.status,
        "value": row.value,
        "low": row.ci_low,
        "high": row.ci_high,
    }


def changes(rows: Sequence[Row], suite: Suite) -> list[Row]:
    """The ranking number of each condition minus that of the baseline, where there is one."""
    rank = suite.rank
    wanted = ("vs-baseline", rank.metric, rank.point, rank.statistic, "all", "all")
    return [
        row
        for row in rows
        if (row.variant, row.metric, row.point, row.statistic, row.band, row.segment) == wanted
        and row.value is not None
    ]


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
                "label": f"change of the {suite.rank.statistic} at the {suite.rank.point}",
                "unit": lines[0].unit,
                "floor": None,
                "rows": [
                    {
                        "name": f"{row.case} {row.condition} - {suite.baseline}",
                        "pooled": False,
                        "status": "ok" if separate(row) else "not separable",
                        "value": row.value,
                        "low": row.ci_low,
                        "high": row.ci_high,
                    }
                    for row in lines
                ],
            }
        )
    return charts


def separate(row: Row) -> bool:
    """Whether a change's interval leaves out nought."""
    return row.ci_low is not None and row.ci_high is not None and row.ci_low * row.ci_high > 0.0
