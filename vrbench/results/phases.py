"""Errors by phase of the motion: what comparisons of runs need, without opening takes."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from io import StringIO
from operator import attrgetter
from pathlib import Path

from vrbench.errors import DataError
from vrbench.metrics.scored import ScoredTake
from vrbench.results.files import replace_text
from vrbench.results.record import TakeRecord
from vrbench.statistics.paired import by_phase
from vrbench.statistics.uncertainty import error_vectors
from vrbench.trajectory import NS


@dataclass(frozen=True, slots=True)
class PhaseRow:
    """The error of one take within one second of the motion.

    Attributes:
        phase: the second of the motion's own time, which runs slower and faster with its speed,
            counted from where the reference starts to move.
        mean: mean error, in `unit`.
        mean_square: mean square error, in its square.
    """

    case: str
    condition: str
    mount: int
    repeat: int
    reference: str
    metric: str
    point: str
    phase: int
    mean: float
    mean_square: float
    unit: str


COLUMNS = [field.name for field in fields(PhaseRow)]
_cells = attrgetter(*COLUMNS)


def phase_rows(take: TakeRecord, scored: ScoredTake | None, reference: str) -> Iterator[PhaseRow]:
    """The aligned errors of a take by second; nothing for a take that has no X."""
    if scored is None or scored.x is None:
        return
    phase = (scored.estimate.t - scored.reference.t[0]) / NS * (take.speed / take.stretch)
    for (metric, point), vectors in error_vectors(scored):
        bins = by_phase(phase, (vectors**2).sum(axis=1) ** 0.5)
        unit = "deg" if "rotation" in metric else "mm"
        for k, mean, square in zip(bins.bin, bins.mean, bins.mean_square, strict=True):
            yield PhaseRow(
                take.case,
                take.condition,
                take.mount,
                take.repeat,
                reference,
                metric,
                point,
                int(k),
                float(mean),
                float(square),
                unit,
            )


def write_phases(rows: Iterable[PhaseRow], path: Path) -> None:
    """A CSV file with a header."""
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for row in rows:
        table.writerow(f"{c:.7g}" if isinstance(c, float) else c for c in _cells(row))
    path.parent.mkdir(exist_ok=True)
    replace_text(path, text.getvalue())


def read_phases(path: Path) -> list[PhaseRow]:
    """The rows of such a file.

    Raises:
        DataError: no such file, other columns, or a cell of another type.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            table = csv.reader(file)
            if next(table, None) != COLUMNS:
                raise DataError("other columns", file=path, fix=",".join(COLUMNS))
            return [
                PhaseRow(a, b, int(c), int(d), e, f, g, int(h), float(i), float(j), k)
                for a, b, c, d, e, f, g, h, i, j, k in table
            ]
    except FileNotFoundError:
        raise DataError("no errors by phase yet", file=path, fix="vrbench evaluate RUN") from None
    except ValueError as error:
        raise DataError("a row can't be read", file=path, fix=str(error)) from None
