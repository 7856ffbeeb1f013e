"""What a run's page shows of its metric table: results by take, headline numbers, every metric."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

from vrbench.config.suite import Suite
from vrbench.results.report.pages import number, three
from vrbench.results.tables import COLUMNS as TABLE
from vrbench.results.tables import STATUSES, Row

Column = tuple[str, str, int, str, str, str]
Place = tuple[str, str, str, str, str]
"""Reference, case, condition, mount, repeat; the last two `all` where takes are pooled."""

APE = "ape.translation.aligned"
# What a take's line shows: heading, unit, decimals, and metric, point, statistic.
COLUMNS: tuple[Column, ...] = (
    ("rmse", "mm", 2, APE, "eye", "rmse"),
    ("mean", "mm", 2, APE, "eye", "mean"),
    ("std", "mm", 2, APE, "eye", "std"),
    ("max", "mm", 2, APE, "eye", "max"),
    ("rmse at tcp", "mm", 2, APE, "tcp", "rmse"),
    ("rotation", "deg", 3, "ape.rotation.aligned", "eye", "rmse"),
    ("RPE 1 s", "mm", 2, "rpe.translation@1s", "eye", "rmse"),
    ("scale", "", 4, "scale", "eye", "value"),
    ("clock offset", "ms", 2, "clock.offset", "", "value"),
    ("rate", "Hz", 2, "timing.rate", "", "value"),
    ("valid", "%", 2, "coverage.valid", "", "value"),
    ("floor", "mm", 2, "floor.total", "eye", "value"),
)
SCOPES = {
    "take": "speaks for these takes only",
    "mount": "speaks for mounts of this sitting",
    "sitting": "speaks for sittings",
}


def ranking(suite: Suite) -> str:
    """The suite's ranking number in words."""
    rank = suite.rank
    metric = "APE" if rank.metric == APE else rank.metric
    return f"{metric}, {rank.statistic} at the {rank.point}"


def columns(rows: Iterable[Row], suite: Suite) -> list[Column]:
    """What the table of takes shows: of `COLUMNS` what the run has, before it what is ranked."""
    units = {(row.metric, row.point, row.statistic): row.unit for row in rows}
    rank = suite.rank
    ranked = (rank.metric, rank.point, rank.statistic)
    found = [column for column in COLUMNS if column[3:] in units]
    if ranked in units and ranked not in {column[3:] for column in COLUMNS}:
        return [(rank.metric, units[ranked], 2, *ranked), *found]
    return found


def shown(lines: Sequence[list[str]], suite: Suite) -> list[list[str]]:
    """The rows that the page shows, of a table's cells: pooled ones and what tables of takes need.

    Where takes are pooled that is a fifth of them; making rows of all would take a site long.
    """
    groups = list(map(GROUP, lines))
    pooled = {group for group, cells in zip(groups, lines, strict=True) if cells[REPEAT] == "all"}
    rank = suite.rank
    wanted = {column[3:] for column in COLUMNS}
    wanted |= {("floor.total", rank.point, "value"), (rank.metric, rank.point, rank.statistic)}
    # a take that has no numbers says why in a row of its own
    wanted.add((rank.metric, "", "value"))
    return [
        cells
        for group, cells in zip(groups, lines, strict=True)
        if cells[REPEAT] == "all"
        or group not in pooled
        or (cells[VARIANT] == "main" and NUMBER(cells) in wanted)
    ]


GROUP = itemgetter(*(TABLE.index(name) for name in ("case", "condition", "reference", "metric")))
NUMBER = itemgetter(*(TABLE.index(name) for name in ("metric", "point", "statistic")))
REPEAT, VARIANT = TABLE.index("repeat"), TABLE.index("variant")


Numbers = Mapping[tuple[str, str, str], Row]


def numbers_of(rows: Iterable[Row]) -> dict[Place, dict[tuple[str, str, str], Row]]:
    """The plain rows of each take and of all together, by metric, point and statistic."""
    found: dict[Place, dict[tuple[str, str, str], Row]] = {}
    for row in rows:
        if (row.variant, row.band, row.segment) == ("main", "all", "all"):
            found.setdefault(_place(row), {})[row.metric, row.point, row.statistic] = row
    return found


@dataclass(frozen=True, slots=True)
class Result:
    """A line of the table of results.

    Attributes:
        name: the take, or what is pooled.
        pooled: whether it is of several takes.
        cells: one for each of `columns`.
        ranked: the row of the suite's ranking metric, if there is one.
        status: how it counts, and `reason` why.
    """

    place: Place
    name: str
    pooled: bool
    cells: Sequence[Row | None]
    ranked: Row | None
    status: str
    reason: str


def results_of(
    rows: Sequence[Row], numbers: Mapping[Place, Numbers], suite: Suite
) -> dict[str, list[Result]]:
    """The lines by reference: each group's takes, then the group as a whole."""
    standings, headings = _standings(rows, suite), columns(rows, suite)
    lines: dict[str, list[Result]] = {}
    for place, found in numbers.items():
        reference, case, condition, mount, repeat = place
        pooled = repeat == "all"
        cells = [found.get((metric, point, statistic)) for *_, metric, point, statistic in headings]
        if not any(cells) or (pooled and mount != "all"):
            continue
        named = case if condition == "default" else f"{case} {condition}"
        named += ", all takes" if pooled else f", mount {mount}, repeat {repeat}"
        ranked = found.get((suite.rank.metric, suite.rank.point, suite.rank.statistic))
        status, reason = standings.get(place, ("skipped", f"{suite.rank.metric} was not computed"))
        lines.setdefault(reference, []).append(
            Result(place, named, pooled, cells, ranked, status, reason)
        )
    for some in lines.values():
        some.sort(key=lambda line: (*suite_order(suite, *line.place[1:3]), line.pooled))
    return lines


def suite_order(suite: Suite, case: str, condition: str) -> tuple[int, int]:
    """Where the suite has a case and a condition; the takes are in an order drawn by lot."""
    cases, conditions = [c.id for c in suite.cases], [c.id for c in suite.conditions]
    return (
        cases.index(case) if case in cases else len(cases),
        conditions.index(condition) if condition in conditions else len(conditions),
    )


def _standings(rows: Iterable[Row], suite: Suite) -> dict[Place, tuple[str, str]]:
    """How each take counts, and why: as the worst of its ranking numbers, of all its epochs."""
    found: dict[Place, Row] = {}
    for row in rows:
        if row.metric == suite.rank.metric and row.variant == "main":
            worst = found.setdefault(_place(row), row)
            if _gravity(row) < _gravity(worst):
                found[_place(row)] = row
    return {place: (row.status, row.reason) for place, row in found.items()}


def _gravity(row: Row) -> int:
    return STATUSES.index(row.status) if row.status in STATUSES else -1


def _place(row: Row) -> Place:
    return (row.reference, row.case, row.condition, row.mount, row.repeat)


# What stands beside the ranking number of a case, where there are few of them.
OTHERS = (
    ("APE, rmse at the tcp", "mm", APE, "tcp", "rmse"),
    ("APE of rotation, rmse", "deg", "ape.rotation.aligned", "eye", "rmse"),
    ("APE, largest at the eye", "mm", APE, "eye", "max"),
)
MOST_GROUPS = 3


def headline(
    results: Mapping[str, Sequence[Result]], numbers: Mapping[Place, Numbers], suite: Suite
) -> list[dict[str, Any]]:
    """The few numbers that a reader wants first, of what is ranked."""
    tiles = []
    scored = {case.id for case in suite.cases if case.role == "scored"}
    for reference, lines in results.items():
        groups: dict[tuple[str, str], Result] = {}
        for line in lines:
            if line.place[1] in scored or not scored:
                groups[line.place[1], line.place[2]] = line  # the last is the pooled one
        # many conditions have their ranking numbers here, and the others in the table
        others = len(groups) * len(results) <= MOST_GROUPS
        for (case, condition), line in groups.items():
            named = case if condition == "default" else f"{case} {condition}"
            named += f" by {reference}" if len(results) > 1 else ""
            row = line.ranked
            if row is None or row.value is None:
                tiles.append({"name": named, "value": "none", "unit": "", "detail": line.reason})
                continue
            detail = ""
            if row.ci_low is not None and row.ci_high is not None:
                detail = f"95 %: {three(row.ci_low)} to {three(row.ci_high)}, "
                detail += SCOPES.get(row.ci_scope, "")
            tiles.append(
                {
                    "name": f"{named}: {ranking(suite)}",
                    "value": three(row.value),
                    "unit": row.unit,
                    "detail": detail,
                }
            )
            for title, unit, metric, point, statistic in OTHERS if others else ():
                other = numbers[line.place].get((metric, point, statistic))
                if other is not None and other.value is not None:
                    tiles.append(
                        {
                            "name": f"{named}: {title}",
                            "value": three(other.value),
                            "unit": unit,
                            "detail": "",
                        }
                    )
    return tiles


STATISTICS = ("rmse", "mean", "median", "std", "min", "max", "p95")


HEADINGS = ("case", "take", "metric", "point", "band", "segment", "variant", "unit")


def metrics(rows: Sequence[Row]) -> list[list[str]]:
    """Every metric, its statistics side by side: of all takes where pooled, else of each take.

    Returns:
        the cells of each line: `HEADINGS`, value, `STATISTICS`, samples, status.
    """
    pooled = {(r.reference, r.case, r.condition, r.metric) for r in rows if r.repeat == "all"}
    lines: dict[tuple[str, ...], tuple[Row, dict[str, Row]]] = {}
    for row in rows:
        if row.repeat != "all" and (row.reference, row.case, row.condition, row.metric) in pooled:
            continue
        key = (*_place(row), row.metric, row.point, row.band, row.segment, row.variant)
        name = row.statistic if row.statistic in STATISTICS or row.statistic == "sse" else "value"
        lines.setdefault(key, (row, {}))[1][name] = row
    return [
        [
            row.case if row.condition == "default" else f"{row.case} {row.condition}",
            "all" if row.repeat == "all" else f"m{row.mount} r{row.repeat}",
            *(row.metric, row.point, row.band, row.segment, row.variant, row.unit),
            number(found["value"].value) if "value" in found else "",
            *(number(found[name].value) if name in found else "" for name in STATISTICS),
            str(row.samples or ""),
            row.status,
        ]
        for row, found in lines.values()
    ]
