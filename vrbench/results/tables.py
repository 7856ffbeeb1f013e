"""Metric tables: long rows, one number each."""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields, replace
from io import StringIO
from pathlib import Path

from vrbench.errors import DataError
from vrbench.results.bundle import replace_text

# Worst first: pooled rows take the worst status of what they pool.
STATUSES = ("failed", "invalid", "extrapolated", "unbracketed", "skipped", "ok")


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
        return astuple(self)[: COLUMNS.index("value")]

    def over(self, *columns: str) -> Row:
        """The row with `all` in these columns of text."""
        return replace(self, **dict.fromkeys(columns, "all"))  # type: ignore[arg-type]


COLUMNS = [field.name for field in fields(Row)]
_NUMBERS = ("value", "ci_low", "ci_high")


def write_rows(rows: Iterable[Row], path: Path) -> None:
    """A CSV file with a header.

    Raises:
        ValueError: a value is not finite: numbers that can't be had are left empty.
    """
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for row in rows:
        if row.value is not None and not math.isfinite(row.value):
            raise ValueError(f"{row.metric} {row.statistic} is {row.value}")
        table.writerow(
            "" if cell is None else f"{cell:.10g}" if isinstance(cell, float) else cell
            for cell in astuple(row)
        )
    path.parent.mkdir(exist_ok=True)
    replace_text(path, text.getvalue())


def read_rows(path: Path) -> list[Row]:
    """The rows of a metric table.

    Raises:
        DataError: no such file, other columns, or a cell of another type.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            table = csv.DictReader(file)
            if table.fieldnames != COLUMNS:
                raise DataError(
                    "other columns than a metric table's", file=path, fix=",".join(COLUMNS)
                )
            return [_row(cells) for cells in table]
    except FileNotFoundError:
        raise DataError("no metrics yet", file=path, fix="vrbench evaluate RUN") from None
    except (ValueError, TypeError) as error:
        raise DataError("a row can't be read", file=path, fix=str(error)) from None


def _row(cells: dict[str, str]) -> Row:
    numbers = {name: float(cells[name]) if cells[name] else None for name in _NUMBERS}
    return Row(**{**cells, **numbers, "samples": int(cells["samples"])})  # type: ignore[arg-type]


def pool(rows: Sequence[Row], *over: str) -> list[Row]:
    """Rows over all members of some columns, of those rows that share all other columns.

    rmse, mean, std, min, max and sse are those of all samples together; other statistics are not
    pooled, because they don't follow from those of the parts.

    Args:
        rows: of the parts; those that are `all` in these columns already are passed over.
        over: the columns, `mount` and `repeat` for a case's takes, `segment` for a take's epochs.
    """
    groups: dict[tuple[str, ...], list[Row]] = defaultdict(list)
    for row in rows:
        if not any(getattr(row, column) == "all" for column in over):
            groups[replace(row.over(*over), statistic="").key].append(row)
    return [row for group in groups.values() for row in _pooled(group, over)]


def _pooled(group: Sequence[Row], over: Sequence[str]) -> Iterable[Row]:
    parts: dict[tuple[str, ...], dict[str, Row]] = defaultdict(dict)
    for row in group:
        parts[tuple(getattr(row, column) for column in over)][row.statistic] = row
    sound = [
        part
        for part in parts.values()
        if all(name in part and part[name].value is not None for name in ("rmse", "mean"))
    ]
    if len(parts) < 2 or len(sound) < len(parts):
        return
    n = sum(p["rmse"].samples for p in sound)
    square = sum((p["rmse"].value or 0.0) ** 2 * p["rmse"].samples for p in sound) / n
    mean = sum((p["mean"].value or 0.0) * p["mean"].samples for p in sound) / n
    worst = min((p["rmse"] for p in sound), key=lambda row: STATUSES.index(row.status))
    numbers = {
        "rmse": math.sqrt(square),
        "mean": mean,
        "std": math.sqrt(max(square - mean**2, 0.0)),
        "sse": square * n,
    }
    for name, choose in (("min", min), ("max", max)):
        ends = [p[name].value for p in sound if name in p]
        if len(ends) == len(sound):
            numbers[name] = choose(value for value in ends if value is not None)
    for statistic, value in numbers.items():
        if statistic in sound[0]:
            yield replace(
                sound[0][statistic].over(*over),
                value=value,
                ci_low=None,
                ci_high=None,
                ci_scope="",
                samples=n,
                status=worst.status,
                reason=worst.reason,
            )
