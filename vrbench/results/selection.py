"""The few rows that a comparison needs, out of tables of thousands, without reading the others."""

from __future__ import annotations

import csv
import re
from collections import defaultdict
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
        rows = list(csv.reader(line.decode() for line in lines))
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
    pattern = rf"\n{re.escape(case)},(\d+),(\d+),{re.escape(what)},(\d+),[^,\n]*,([^,\n]*),"
    cells: dict[tuple[bytes, bytes], list[tuple[int, float]]] = defaultdict(list)
    try:
        for mount, repeat, phase, square in re.findall(pattern.encode(), text):
            cells[mount, repeat].append((int(phase), float(square)))
    except ValueError as error:
        raise DataError("a row can't be read", file=path, fix=str(error)) from None
    bins = {(int(m), int(r)): np.array(sorted(numbers)) for (m, r), numbers in cells.items()}
    return {
        place: (bins[place][:, 0].astype(np.int64), bins[place][:, 1])
        for place in ((take.mount, take.repeat) for take in takes)
        if place in bins
    }


def _check_header(path: Path, text: bytes, columns: Sequence[str]) -> None:
    header = ",".join(columns)
    if not text.startswith(f"{header}\n".encode()):
        raise DataError("other columns than this table's", file=path, fix=header)
