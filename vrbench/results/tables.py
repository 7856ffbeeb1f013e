"""Metric tables: long rows, one number each."""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from io import StringIO
from math import isfinite
from operator import attrgetter
from pathlib import Path
from typing import Any

from vrbench.errors import DataError
from vrbench.text_file import replace_text

# Worst first: pooled rows take the worst status of what they pool.
STATUSES = ("failed", "invalid", "extrapolated", "unbracketed", "skipped", "ok")
SCOPES = ("take", "mount", "sitting")
# What has no sign, except in a difference: of anything, and of the lengths of errors.
UNSIGNED = frozenset(("rmse", "std", "sse", "count"))
LENGTHS = frozenset(("mean", "median", "min", "max", "p95", "value"))
DIFFERENCE = "vs-baseline"
# Per cent, with what rounding does.
WHOLE = 100.001
# The values of the columns that rows are pooled over.
Member = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Row:
    """One number; all up to `statistic` is its key. An empty value has a status that says why."""

    protocol: str
    device: str
    suite: str
    case: str
    condition: str
    sitting: str
    mount: str
    repeat: str
    segment: str
    reference: str
    variant: str
    metric: str
    point: str
    band: str
    statistic: str
    value: float | None
    unit: str
    ci_low: float | None = None
    ci_high: float | None = None
    ci_scope: str = ""
    samples: int = 0
    status: str = "ok"
    reason: str = ""

    @property
    def key(self) -> tuple[str, ...]:
        return _cells(self)[: _AT[0]]

    def over(self, *columns: str) -> Row:
        """The row with `all` in these columns of text."""
        return replace(self, **dict.fromkeys(columns, "all"))  # type: ignore[arg-type]


COLUMNS = [field.name for field in fields(Row)]
_cells = attrgetter(*COLUMNS)
_NUMBERS = ("value", "ci_low", "ci_high")
_AT = tuple(COLUMNS.index(name) for name in _NUMBERS)
_SAMPLES = COLUMNS.index("samples")


def write_rows(rows: Iterable[Row], path: Path) -> None:
    """A CSV file with a header.

    Raises:
        ValueError: a value is not finite: numbers that can't be had are left empty.
    """
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for row in rows:
        # a line of the file is a row, whatever a plugin breaks its reasons with
        row = replace(row, reason=" ".join(row.reason.split()))
        if row.value is not None and not isfinite(row.value):
            raise ValueError(f"{row.metric} {row.statistic} is {row.value}")
        table.writerow(
            "" if cell is None else f"{cell:.10g}" if isinstance(cell, float) else cell
            for cell in _cells(row)
        )
    path.parent.mkdir(exist_ok=True)
    replace_text(path, text.getvalue())


def read_rows(path: Path) -> list[Row]:
    """The rows of a metric table.

    Raises:
        DataError: no such file, other columns, or a cell of another type.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise DataError("no metrics yet", file=path, fix="vrbench evaluate RUN") from None
    return parse_rows(content, path)


def parse_rows(content: bytes, path: Path) -> list[Row]:
    """The rows of a metric table's content; `path` is for messages.

    Raises:
        DataError: other columns, or a cell of another type.
    """
    return rows_of(parse_cells(content, path), path)


def parse_cells(content: bytes, path: Path) -> list[list[str]]:
    """The cells of each row of a metric table, in the order of `COLUMNS`, as they are written.

    Raises:
        DataError: other columns, or a row of another length.
    """
    try:
        written = content.decode().splitlines()
        # what no quote stands in needs no parser, which takes three times as long
        plain = b'"' not in content
        lines = [line.split(",") for line in written] if plain else list(csv.reader(written))
    except (ValueError, csv.Error) as error:
        raise DataError("is no table", file=path, fix=str(error)) from None
    if not lines or lines[0] != COLUMNS:
        raise DataError("other columns than a metric table's", file=path, fix=",".join(COLUMNS))
    odd = next((k for k, cells in enumerate(lines, 1) if len(cells) != len(COLUMNS)), None)
    if odd is not None:
        raise DataError(
            f"row {odd} has {len(lines[odd - 1])} cells", file=path, fix=f"{len(COLUMNS)} a row"
        )
    return lines[1:]


def rows_of(lines: Iterable[list[str]], path: Path) -> list[Row]:
    """Rows of cells in the order of `COLUMNS`.

    Raises:
        DataError: a cell of another type.
    """
    try:
        return [_row(cells) for cells in lines]
    except ValueError as error:
        raise DataError("a row can't be read", file=path, fix=str(error)) from None


def _row(cells: list[str]) -> Row:
    typed: list[Any] = cells.copy()
    for k in _AT:
        typed[k] = float(cells[k]) if cells[k] else None
        if typed[k] is not None and not isfinite(typed[k]):
            raise ValueError(f"{COLUMNS[k]} is {cells[k]}")
    typed[_SAMPLES] = int(cells[_SAMPLES])
    if typed[_SAMPLES] < 0:
        raise ValueError(f"samples is {cells[_SAMPLES]}")
    row = Row(*typed)
    if row.status not in STATUSES:
        raise ValueError(f"status is {row.status!r}, none of {', '.join(STATUSES)}")
    if row.value is not None and row.value < 0.0 and _unsigned(row):
        raise ValueError(f"{row.metric} {row.statistic} is {row.value:g}, which can't be negative")
    share = row.unit == "%" and row.variant != DIFFERENCE
    if share and row.value is not None and not 0.0 <= row.value <= WHOLE:
        raise ValueError(f"{row.metric} is {row.value:g} %")
    if row.ci_low is not None or row.ci_high is not None:
        _check_interval(row)
    return row


def _unsigned(row: Row) -> bool:
    if row.variant == DIFFERENCE:
        return False
    error = row.metric.startswith(("ape.", "rpe.", "floor."))
    return row.statistic in UNSIGNED or (error and row.statistic in LENGTHS)


def _check_interval(row: Row) -> None:
    """An interval has two ends, a value and a scope; it needn't hold the value (bootstrap)."""
    if row.value is None or row.ci_low is None or row.ci_high is None or row.ci_low > row.ci_high:
        raise ValueError(f"{row.metric}: the interval {row.ci_low} to {row.ci_high} is none")
    if row.ci_scope not in SCOPES:
        raise ValueError(f"ci_scope is {row.ci_scope!r}, none of {', '.join(SCOPES)}")


def pool(rows: Sequence[Row], over: Sequence[str], members: Mapping[Member, str]) -> list[Row]:
    """Rows over all members of some columns, of those rows that share all other columns.

    rmse, mean, std, min, max and sse are those of all samples together; other statistics are not
    pooled, because they don't follow from those of the parts. Where a member has no number, there
    is none for all together either: one row says so, and why.

    Args:
        rows: of the parts; those that are `all` in these columns already are passed over.
        over: the columns, `mount` and `repeat` for a case's takes, `segment` for a take's epochs.
        members: all that there should be, as values of these columns; each with why it has no
            numbers, empty where it should have them.
    """
    if len(members) < 2:
        return []
    groups: dict[tuple[str, ...], dict[Member, dict[str, Row]]] = defaultdict(
        lambda: defaultdict(dict)
    )
    for row in rows:
        member = tuple(getattr(row, column) for column in over)
        if member in members:
            key = replace(row.over(*over), statistic="").key
            groups[key][member][row.statistic] = row
    pooled: list[Row] = []
    for parts in groups.values():
        if any("rmse" in part for part in parts.values()):
            missing = _missing(parts, over, members)
            pooled += [missing] if missing else _pooled(list(parts.values()), over)
    return pooled


def _missing(
    parts: Mapping[Member, Mapping[str, Row]], over: Sequence[str], members: Mapping[Member, str]
) -> Row | None:
    """The row that says which member has no number, and why; None where all have one."""
    for member, why in members.items():
        rmse = parts.get(member, {}).get("rmse")
        if rmse is None or rmse.value is None:
            like = next(part["rmse"] for part in parts.values() if "rmse" in part)
            reason = (rmse.reason if rmse else "") or why or "it has no such number"
            named = " ".join(f"{c} {v}" for c, v in zip(over, member, strict=True))
            return replace(
                like.over(*over),
                value=None,
                ci_low=None,
                ci_high=None,
                ci_scope="",
                samples=0,
                status=rmse.status if rmse else "failed",
                reason=f"{named}: {reason}",
            )
    return None


def _pooled(parts: Sequence[Mapping[str, Row]], over: Sequence[str]) -> Iterable[Row]:
    n = sum(p["rmse"].samples for p in parts)
    square = sum((p["rmse"].value or 0.0) ** 2 * p["rmse"].samples for p in parts) / n
    worst = min((p["rmse"] for p in parts), key=lambda row: STATUSES.index(row.status))
    numbers = {"rmse": math.sqrt(square), "sse": square * n}
    if all("mean" in p and p["mean"].value is not None for p in parts):
        mean = sum((p["mean"].value or 0.0) * p["mean"].samples for p in parts) / n
        numbers |= {"mean": mean, "std": math.sqrt(max(square - mean**2, 0.0))}
    for name, choose in (("min", min), ("max", max)):
        ends = [p[name].value for p in parts if name in p]
        if len(ends) == len(parts):
            numbers[name] = choose(value for value in ends if value is not None)
    for statistic, value in numbers.items():
        if statistic in parts[0]:
            yield replace(
                parts[0][statistic].over(*over),
                value=value,
                ci_low=None,
                ci_high=None,
                ci_scope="",
                samples=n,
                status=worst.status,
                reason=worst.reason,
            )
