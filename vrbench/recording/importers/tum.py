"""TUM text: rows `t x y z qx qy qz qw`."""

from __future__ import annotations

from codecs import BOM_UTF8
from os import SEEK_END
from pathlib import Path

from vrbench.errors import DataError
from vrbench.recording.checks import imported_poses
from vrbench.recording.importer import Imported, Importer, NoOptions
from vrbench.recording.text_table import parse_fields, whole_lines
from vrbench.trajectory import NS, tum_columns

COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
FIX = "each row is `t x y z qx qy qz qw`"


def read(path: Path, _options: NoOptions) -> Imported:
    """The poses of a TUM file (s, m); receive time is the stamp.

    A last row without its newline may lack digits: it is left out, and that is told.

    Raises:
        DataError: no such file, no rows, a row of another shape, and as
            `vrbench.recording.checks.imported_poses`.
    """
    if _is_plain(path):
        t, p, q = tum_columns(path)
        return imported_poses(t, p, q, file=path)
    lines, repairs = whole_lines(path, fix=FIX)
    rows = [line.split() for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if not rows:
        raise DataError("holds no poses", file=path, fix=FIX)
    t, values = parse_fields(
        rows, COLUMNS, stamp="t", values=COLUMNS[1:], unit_ns=NS, file=path, first_line=1
    )
    return imported_poses(t, values[:, :3], values[:, 3:], file=path, repairs=repairs)


def _is_plain(path: Path) -> bool:
    """Whether a file ends with a newline and has no byte-order mark; others are read with care."""
    try:
        with path.open("rb") as file:
            head = file.read(len(BOM_UTF8))
            file.seek(max(file.seek(0, SEEK_END) - 1, 0))
            return head != BOM_UTF8 and file.read() in (b"\n", b"")
    except OSError:
        return True


IMPORTER = Importer(name="tum", title="TUM text: t x y z qx qy qz qw (s, m)", read=read)
