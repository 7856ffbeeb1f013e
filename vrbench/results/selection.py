"""The few rows that a comparison needs, out of tables of thousands, without reading the others.

Tables begin a row with what it is of, and keep the rows of a take below each other; so a row is
found by the beginning of its line.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from functools import lru_cache
from io import BytesIO, StringIO
from pathlib import Path

import numpy as np

from vrbench.errors import DataError
from vrbench.geometry import Floats, Ints
from vrbench.results.phases import COLUMNS as PHASE_COLUMNS
from vrbench.results.record import TakeRecord
from vrbench.results.tables import COLUMNS, Row, rows_of

Place = tuple[int, int]
_BIN = np.dtype([("phase", np.int64), ("mean_square", np.float64)])
_BIN_AT = tuple(PHASE_COLUMNS.index(name) for name in _BIN.names or ())


class MetricTable:
    """A metric table, its rows by their key.

    All its rows are of one protocol, device, suite and sitting, as the first one says.

    Args:
        path: of the table, for messages.
        text: its content.

    Raises:
        DataError: other columns.
    """

    def __init__(self, path: Path, text: bytes) -> None:
        _check_header(path, text, COLUMNS)
        self._path, self._text = path, text
        first = self._cells(text.find(b"\n") + 1)
        self._run, self._sitting = tuple(first[:3]), first[5:6]
        # where the rows of a take begin; -1 where it has none
        self._begins: dict[bytes, int] = {}
        self._last = 0

    def row(self, take: tuple[str, ...], number: tuple[str, ...]) -> Row | None:
        """A row; None where there is no such row.

        Args:
            take: its case, condition, mount and repeat.
            number: its segment, reference, variant, metric, point, band and statistic.

        Raises:
            DataError: a cell of another type.
        """
        case, condition, mount, repeat = take
        of = _beginning((*self._run, case, condition, *self._sitting, mount, repeat))
        begins = self._begins.get(of)
        if begins is None:
            begins = self._begins[of] = _line(self._text, of, self._last)
            self._last = max(begins, 0)
        if begins < 0:
            return None
        at = self._text.find(b"\n" + of + _beginning(number), begins)
        if at < 0:
            return None
        cells = self._cells(at + 1)
        if len(cells) != len(COLUMNS):
            why = f"it has {len(cells)} cells, not {len(COLUMNS)}"
            raise DataError("a row can't be read", file=self._path, fix=why)
        return rows_of([cells], self._path)[0]

    def _cells(self, at: int) -> list[str]:
        """The cells of the line that begins there."""
        end = self._text.find(b"\n", at)
        try:
            line = self._text[at : end if end >= 0 else None].decode()
            # what no quote stands in needs no parser
            return next(csv.reader([line])) if '"' in line else line.split(",")
        except (ValueError, csv.Error) as error:
            raise DataError("a row can't be read", file=self._path, fix=str(error)) from None


def select_bins(
    path: Path,
    text: bytes,
    takes: Sequence[TakeRecord],
    *,
    reference: str,
    metric: str,
    point: str,
) -> dict[Place, tuple[Ints, Floats]]:
    """Bins of phase and mean square errors (b,) in them, by mount and repeat of these takes.

    Args:
        path: of a table of errors by phase, for messages.
        text: its content.
        takes: the takes; those that the table lacks are left out.
        reference: against which,
        metric: which error,
        point: and where.

    Raises:
        DataError: other columns, or a cell of another type.
    """
    _check_header(path, text, PHASE_COLUMNS)
    table, last = BytesIO(text), 0
    lines: list[bytes] = []
    ends: dict[Place, int] = {}
    for take in takes:
        of = (take.case, take.condition, str(take.mount), str(take.repeat))
        begins = _beginning((*of, reference, metric, point))
        at = _line(text, begins, last)
        if at < 0:
            continue
        last = at
        table.seek(at + 1)
        for line in table:
            if not line.startswith(begins):
                break
            lines.append(line)
        ends[take.mount, take.repeat] = len(lines)
    try:
        return dict(zip(ends, _bins(lines, list(ends.values())), strict=True))
    except ValueError as error:
        raise DataError("a row can't be read", file=path, fix=str(error)) from None


def _bins(lines: Sequence[bytes], ends: Sequence[int]) -> list[tuple[Ints, Floats]]:
    """Phases and mean squares of rows, by take; the rows of each end at one of `ends`."""
    if not ends:
        return []
    read = np.loadtxt(
        lines, _BIN, comments=None, delimiter=",", usecols=_BIN_AT, ndmin=1, quotechar='"'
    )
    number, square = read["phase"].copy(), read["mean_square"].copy()
    steps = np.diff(number)
    steps[np.array(ends[:-1], dtype=np.int64) - 1] = 1
    if (steps <= 0).any():
        raise ValueError("the bins of a take don't follow each other")
    if not (np.isfinite(square) & (square >= 0.0)).all():
        raise ValueError("a mean square is a number, and not negative")
    starts = [0, *ends[:-1]]
    return [(number[a:b], square[a:b]) for a, b in zip(starts, ends, strict=True)]


def _line(text: bytes, begins: bytes, near: int) -> int:
    """Where the line break before the first such line is; -1 where there is none.

    Tables are in the order of takes: what is sought next mostly stands below the last that was.
    """
    found = text.find(b"\n" + begins, near)
    return text.find(b"\n" + begins) if found < 0 < near else found


@lru_cache(maxsize=1024)
def _beginning(cells: tuple[str, ...]) -> bytes:
    """How a line, or a part of one, begins that has these cells."""
    line = StringIO()
    csv.writer(line, lineterminator="\n").writerow(cells)
    return line.getvalue()[:-1].encode() + b","


def _check_header(path: Path, text: bytes, columns: Sequence[str]) -> None:
    header = ",".join(columns)
    if not text.startswith(f"{header}\n".encode()):
        raise DataError("other columns than this table's", file=path, fix=header)
