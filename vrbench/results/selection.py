"""The few rows that a comparison needs, out of tables of thousands, without reading the others."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from vrbench.errors import DataError
from vrbench.geometry import Floats, Ints
from vrbench.results.bundle import TakeRecord
from vrbench.results.phases import COLUMNS as PHASE_COLUMNS
from vrbench.results.tables import COLUMNS, Row, row_of

Place = tuple[int, int]


def select_rows(path: Path, text: bytes, holding: Iterable[str]) -> list[Row]:
    """The rows of a metric table whose lines hold one of some texts.

    Args:
        path: of the table, for messages.
        text: its content.
        holding: the texts, with the commas around their cells.

    Raises:
        DataError: other columns, or a cell of another type.
    """
    _check_header(path, text, COLUMNS, "a metric table's")
    found: dict[int, None] = {}
    for needle in holding:
        wanted, at = needle.encode(), 0
        while (at := text.find(wanted, at)) >= 0:
            found[text.rfind(b"\n", 0, at) + 1] = None
            at = _line_end(text, at)
    lines = (text[start : _line_end(text, start)].decode() for start in sorted(found))
    try:
        return [row_of(dict(zip(COLUMNS, cells, strict=True))) for cells in csv.reader(lines)]
    except (ValueError, TypeError, csv.Error) as error:
        raise DataError("a row can't be read", file=path, fix=str(error)) from None


def select_bins(
    path: Path,
    text: bytes,
    takes: Iterable[TakeRecord],
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
    _check_header(path, text, PHASE_COLUMNS, "a table of errors by phase")
    starts: Mapping[bytes, Place] = {
        f"{t.case},{t.condition},{t.mount},{t.repeat},{reference},{metric},{point},".encode(): (
            t.mount,
            t.repeat,
        )
        for t in takes
    }
    beginnings, cells = tuple(starts), len(PHASE_COLUMNS)
    column = PHASE_COLUMNS.index("phase")
    found: dict[Place, list[tuple[int, float]]] = {}
    try:
        for line in text.split(b"\n"):
            if line.startswith(beginnings):
                parts = line.split(b",")
                if len(parts) != cells:
                    raise ValueError(f"{len(parts)} cells, not {cells}")
                place = int(parts[2]), int(parts[3])
                found.setdefault(place, []).append((int(parts[column]), float(parts[column + 2])))
    except ValueError as error:
        raise DataError("a row can't be read", file=path, fix=str(error)) from None
    return {
        place: (np.array([b for b, _ in bins]), np.array([square for _, square in bins]))
        for place, bins in ((place, sorted(bins)) for place, bins in found.items())
    }


def _check_header(path: Path, text: bytes, columns: list[str], whose: str) -> None:
    if text[: _line_end(text, 0)].rstrip(b"\r").decode(errors="replace") != ",".join(columns):
        raise DataError(f"other columns than {whose}", file=path, fix=",".join(columns))


def _line_end(text: bytes, at: int) -> int:
    end = text.find(b"\n", at)
    return len(text) if end < 0 else end
