"""TUM text: rows `t x y z qx qy qz qw`."""

from __future__ import annotations

from codecs import BOM_UTF8
from os import SEEK_END
from pathlib import Path

from vrbench.errors import DataError
from vrbench.geometry import Transform
from vrbench.recording.checks import imported_poses
from vrbench.recording.importer import AxesOptions, Imported, Importer
from vrbench.recording.text_table import filled_lines, parse_fields
from vrbench.trajectory import NS, tum_columns

COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
FIX = "each row is `t x y z qx qy qz qw`"


def read(path: Path, options: AxesOptions) -> Imported:
    """The poses of a TUM file (s, m); receive time is the stamp.

    A last row without its newline may lack digits: it is left out, and that is told.

    Raises:
        DataError: no such file, no rows, a row of another shape, and as
            `vrbench.recording.checks.imported_poses`.
    """
    if _is_plain(path):
        t, p, q = tum_columns(path)
        pose = options.to_openxr(Transform(p, q))
        return imported_poses(t, pose.p, pose.q, file=path)
    lines = filled_lines(path, fix=FIX)
    rows = [
        (number, line.split())
        for number, line in zip(lines.numbers, lines.text, strict=True)
        if not line.lstrip().startswith("#")
    ]
    if not rows:
        raise DataError("holds no poses", file=path, fix=FIX)
    t, values = parse_fields(
        [row for _, row in rows],
        COLUMNS,
        stamp="t",
        values=COLUMNS[1:],
        unit_ns=NS,
        file=path,
        numbers=[number for number, _ in rows],
    )
    pose = options.to_openxr(Transform(values[:, :3], values[:, 3:]))
    return imported_poses(t, pose.p, pose.q, file=path, repairs=lines.repairs)


def _is_plain(path: Path) -> bool:
    """Whether a file ends with a newline and has no byte-order mark; others are read with care."""
    try:
        with path.open("rb") as file:
            head = file.read(len(BOM_UTF8))
            file.seek(max(file.seek(0, SEEK_END) - 1, 0))
            return head != BOM_UTF8 and file.read() in (b"\n", b"")
    except OSError:
        return True


IMPORTER = Importer(
    name="tum",
    title="TUM text: t x y z qx qy qz qw (s, m)",
    read=read,
    options=AxesOptions,
)
