"""Logs of poses as text, a line a pose: whole lines, and columns whose bad values are named.

Public to the authors of plugins.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from decimal import Decimal
from pathlib import Path

import numpy as np

from vrbench.errors import DataError
from vrbench.geometry import Floats, Ints


def whole_lines(path: Path, *, fix: str) -> tuple[list[str], tuple[str, ...]]:
    """The lines of a text file that end in a newline, and a sentence on what was left out.

    A last line without its newline is never trusted: it may have every column, and yet lack the
    last digits of the last number.

    Args:
        path: of the file, UTF-8.
        fix: what the file should hold, for errors.

    Raises:
        DataError: no such file, nothing in it, no whole line.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig", errors="replace")
    except OSError as error:
        raise DataError("can't be read", file=path, fix=error.strerror) from error
    if not text.strip():
        raise DataError("is empty", file=path, fix=fix)
    whole, _, rest = text.rpartition("\n")
    if not whole.strip():
        raise DataError("holds no whole line: the only one has no newline", file=path, fix=fix)
    lines = [line.rstrip("\r") for line in whole.rstrip("\r\n").split("\n")]
    if not rest.strip():
        return lines, ()
    return lines, (f"line {whole.count(chr(10)) + 2} left out: the file ends in the midst of it",)


def parse_columns(
    lines: Sequence[str],
    columns: Sequence[str],
    *,
    stamp: str,
    values: Sequence[str],
    file: Path,
    first_line: int = 1,
) -> tuple[Ints, Floats]:
    """Stamps (n,), in whole numbers and exact, and values (n, k) of n lines split by commas.

    Args:
        lines: of the file, without newlines.
        columns: the names of all columns, in order.
        stamp: the name of the column of stamps.
        values: the names of the columns of values (k,).
        file: named in errors.
        first_line: the number of the first of the lines in the file.

    Raises:
        DataError: a line of more or fewer columns, a value that is no number.
    """
    for number, line in enumerate(lines, first_line):
        if line.count(",") != len(columns) - 1:
            raise DataError(
                f"has {line.count(',') + 1} columns",
                file=file,
                field=f"line {number}",
                fix=told(columns),
            )
    parsers: dict[int, Callable[[str], object]] = {columns.index(stamp): np.int64}
    parsers |= {columns.index(name): float for name in values}
    try:
        with warnings.catch_warnings():
            # numpy before 2 reads "1.5" as the integer 1, and only warns
            warnings.simplefilter("error", DeprecationWarning)
            rows = np.loadtxt(
                lines,
                dtype=[("stamp", np.int64), ("values", np.float64, len(values))],
                delimiter=",",
                usecols=tuple(parsers),
                comments=None,
                ndmin=1,
            )
    except (ValueError, DeprecationWarning) as error:
        bad = _bad_value(lines, columns, parsers, file, first_line)
        raise bad or DataError(str(error), file=file, fix=told(columns)) from error
    return rows["stamp"], rows["values"]


def parse_fields(
    rows: Sequence[Sequence[str]],
    columns: Sequence[str],
    *,
    stamp: str,
    values: Sequence[str],
    unit_ns: int,
    file: Path,
    first_line: int = 1,
) -> tuple[Ints, Floats]:
    """Stamps (n,) [ns] and values (n, k) of n lines that are split already.

    Stamps may have a decimal point and are read to the last nanosecond: as floats, seconds since
    1970 would lose digits.

    Args:
        rows: the fields of each line.
        columns: the names of all columns, in order.
        stamp: the name of the column of stamps.
        values: the names of the columns of values (k,).
        unit_ns: the unit of the stamps [ns].
        file: named in errors.
        first_line: the number of the first of the lines in the file.

    Raises:
        DataError: a line of more or fewer columns, a value that is no number.
    """
    at = columns.index(stamp)
    places = [columns.index(name) for name in values]
    t = np.empty(len(rows), dtype=np.int64)
    found = np.empty((len(rows), len(values)))
    for i, row in enumerate(rows):
        if len(row) != len(columns):
            raise DataError(
                f"has {len(row)} columns",
                file=file,
                field=f"line {first_line + i}",
                fix=told(columns),
            )
        place = at
        try:
            t[i] = int((Decimal(row[at]) * unit_ns).to_integral_value())
            for k, place in enumerate(places):
                found[i, k] = float(row[place])
        except (ArithmeticError, ValueError):
            raise DataError(
                f"{row[place]!r} is not a number",
                file=file,
                field=f"line {first_line + i}, column {place + 1} ({columns[place]})",
            ) from None
    return t, found


def told(columns: Sequence[str]) -> str:
    """Columns, for errors."""
    return f"{len(columns)} columns: {', '.join(columns)}"


def _bad_value(
    lines: Sequence[str],
    columns: Sequence[str],
    parsers: dict[int, Callable[[str], object]],
    file: Path,
    first_line: int,
) -> DataError | None:
    """An error that names the first value that is no number."""
    for number, line in enumerate(lines, first_line):
        fields = line.split(",")
        for column, parse in parsers.items():
            try:
                parse(fields[column])
            except (ValueError, OverflowError):
                kind = "a number" if parse is float else "a whole number"
                return DataError(
                    f"{fields[column]!r} is not {kind}",
                    file=file,
                    field=f"line {number}, column {column + 1} ({columns[column]})",
                )
    return None
