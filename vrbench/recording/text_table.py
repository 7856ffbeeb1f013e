"""Logs of poses as text, a line a pose: whole lines, and columns whose bad values are named.

Public to the authors of plugins.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from vrbench.errors import DataError
from vrbench.geometry import Floats, Ints

# 292 years, what nanoseconds say in int64.
LATEST_NS = 2**63 - 1


# A disk that was full leaves zeros where a line should be.
BLANK = " \t\v\f\r\0"


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


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines of a file that say something.

    Attributes:
        text: each without its newline (n,).
        numbers: of each in the file, counted from 1 (n,).
        repairs: what was left out, a sentence each.
    """

    text: list[str]
    numbers: list[int]
    repairs: tuple[str, ...]

    def __getitem__(self, part: slice) -> Lines:
        return Lines(self.text[part], self.numbers[part], self.repairs)


def filled_lines(path: Path, *, fix: str) -> Lines:
    """The whole lines of a text file that aren't blank; those that are, are passed by and told.

    Raises:
        DataError: as `whole_lines`.
    """
    lines, repairs = whole_lines(path, fix=fix)
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip(BLANK)]
    if not numbered:
        raise DataError("is empty", file=path, fix=fix)
    if len(numbered) < len(lines):
        first = next(number for number, line in enumerate(lines, 1) if not line.strip(BLANK))
        many = len(lines) - len(numbered)
        what = f"{many} blank lines" if many > 1 else "a blank line"
        repairs = (*repairs, f"{what} passed by (first: line {first})")
    return Lines([line for _, line in numbered], [number for number, _ in numbered], repairs)


def parse_columns(
    lines: Sequence[str],
    columns: Sequence[str],
    *,
    stamp: str,
    values: Sequence[str],
    file: Path,
    numbers: Sequence[int] | None = None,
) -> tuple[Ints, Floats]:
    """Stamps (n,), in whole numbers and exact, and values (n, k) of n lines split by commas.

    Args:
        lines: of the file, without newlines.
        columns: the names of all columns, in order.
        stamp: the name of the column of stamps.
        values: the names of the columns of values (k,).
        file: named in errors.
        numbers: of the lines in the file (n,); counted from 1 where not given.

    Raises:
        DataError: a line of more or fewer columns, a value that is no number.
    """
    numbers = range(1, len(lines) + 1) if numbers is None else numbers
    for number, line in zip(numbers, lines, strict=True):
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
        bad = _bad_value(lines, columns, parsers, file, numbers)
        raise bad or DataError(str(error), file=file, fix=told(columns)) from error
    return rows["stamp"], rows["values"]


def parse_fields(
    rows: Sequence[Sequence[str]],
    columns: Sequence[str],
    *,
    stamp: str,
    values: Sequence[str],
    unit_ns: int,
    origin: int = 0,
    file: Path,
    numbers: Sequence[int] | None = None,
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
        origin: what is taken from each stamp, in its unit.
        file: named in errors.
        numbers: of the lines in the file (n,); counted from 1 where not given.

    Raises:
        DataError: a line of more or fewer columns, a value that is no number, a stamp past what
            nanoseconds can say.
    """
    numbers = range(1, len(rows) + 1) if numbers is None else numbers
    at = columns.index(stamp)
    places = [columns.index(name) for name in values]
    t = np.empty(len(rows), dtype=np.int64)
    found = np.empty((len(rows), len(values)))
    for i, (number, row) in enumerate(zip(numbers, rows, strict=True)):
        if len(row) != len(columns):
            raise DataError(
                f"has {len(row)} columns",
                file=file,
                field=f"line {number}",
                fix=told(columns),
            )
        place = at
        try:
            stamp_ns = int(((Decimal(row[at]) - origin) * unit_ns).to_integral_value())
            if abs(stamp_ns) > LATEST_NS:
                raise DataError(
                    f"{row[at]!r} is no time since 1970, nor since a device's start",
                    file=file,
                    field=f"line {number}, column {at + 1} ({stamp})",
                    fix="another unit of time?",
                )
            t[i] = stamp_ns
            for k, place in enumerate(places):
                found[i, k] = float(row[place])
        except (ArithmeticError, ValueError):
            raise DataError(
                f"{row[place]!r} is not a number",
                file=file,
                field=f"line {number}, column {place + 1} ({columns[place]})",
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
    numbers: Sequence[int],
) -> DataError | None:
    """An error that names the first value that is no number."""
    for number, line in zip(numbers, lines, strict=True):
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
