"""The few rows that a comparison needs, out of tables of thousands, without reading the others."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vrbench.errors import DataError
from vrbench.geometry import Floats, Ints
from vrbench.results.phases import COLUMNS as PHASE_COLUMNS
from vrbench.results.record import TakeRecord
from vrbench.results.tables import COLUMNS, Row, rows_of

Place = tuple[int, int]


def select_rows(
    path: Path, text: bytes, *, reference: str, variant: str, cells: Sequence[str]
) -> list[Row]:
    """The rows of a metric table that have one of some successions of cells.

    Args:
        path: of the table, for messages.
        text: its content.
        reference: against which the rows are,
        variant: and of which variant.
        cells: what may stand from the metric on, as regular expressions: `scale,eye,all` say.

    Raises:
        DataError: other columns, or a cell of another type.
    """
    _check_header(path, text, COLUMNS)
    pattern = f",{re.escape(reference)},{re.escape(variant)},(?:{'|'.join(cells)}),"
    lines = []
    for found in re.finditer(pattern.encode(), text):
        end = text.find(b"\n", found.end())
        lines.append(text[text.rfind(b"\n", 0, found.start()) + 1 : end if end >= 0 else None])
    try:
        written = [line.decode() for line in lines]
        # what no quote stands in needs no parser
        plain = not any('"' in line for line in written)
        rows = [line.split(",") for line in written] if plain else list(csv.reader(written))
        if any(len(row) != len(COLUMNS) for row in rows):
            raise ValueError(f"it has not {len(COLUMNS)} cells")
        return rows_of(rows, path)
    except (ValueError, TypeError, csv.Error) as error:
        raise DataError("a row can't be read", file=path, fix=str(error)) from None


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
        takes: the takes, of one case and condition; those that the table lacks are left out.
        reference: against which,
        metric: which error,
        point: and where.

    Raises:
        DataError: other columns, or a cell of another type.
    """
    _check_header(path, text, PHASE_COLUMNS)
    case, what = f"{takes[0].case},{takes[0].condition}", f"{reference},{metric},{point}"
    # the bins of a take stand below each other: lines that begin alike
    block = rf"\n({re.escape(case)},(\d+),(\d+),{re.escape(what)},)[^\n]*(?:\n\1[^\n]*)*"
    known = {(take.mount, take.repeat) for take in takes}
    bins: dict[Place, tuple[Ints, Floats]] = {}
    try:
        for found in re.finditer(block.encode(), text):
            start, place = found[1], (int(found[2]), int(found[3]))
            if place in bins:
                raise ValueError(f"the bins of mount {place[0]}, repeat {place[1]} are torn apart")
            cells = found[0][len(start) + 1 :].replace(b"\n" + start, b",").split(b",")
            if place in known:
                bins[place] = _bins(cells)
    except ValueError as error:
        raise DataError("a row can't be read", file=path, fix=str(error)) from None
    return bins


def _bins(cells: Sequence[bytes]) -> tuple[Ints, Floats]:
    """Bins and mean squares, of cells of phase, mean, mean square and unit, row by row."""
    if len(cells) % 4:
        raise ValueError("it has not as many cells as the header")
    number, square = np.array([*map(int, cells[::4])]), np.array([*map(float, cells[2::4])])
    if (np.diff(number) <= 0).any():
        raise ValueError("the bins of a take don't follow each other")
    if not (np.isfinite(square) & (square >= 0.0)).all():
        raise ValueError("a mean square is a number, and not negative")
    return number, square


def _check_header(path: Path, text: bytes, columns: Sequence[str]) -> None:
    header = ",".join(columns)
    if not text.startswith(f"{header}\n".encode()):
        raise DataError("other columns than this table's", file=path, fix=header)
