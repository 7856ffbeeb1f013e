"""EuRoC CSV, as Monado and the EuRoC ground truth write it: nanoseconds, quaternions w first."""

from __future__ import annotations

from pathlib import Path

from vrbench.errors import DataError
from vrbench.recording.checks import imported_poses
from vrbench.recording.importer import Imported, Importer, NoOptions
from vrbench.recording.text_table import parse_columns, told, whole_lines

COLUMNS = ("timestamp", "x", "y", "z", "qw", "qx", "qy", "qz")
XYZW = ("x", "y", "z", "qx", "qy", "qz", "qw")
# The data set's own ground truth goes on with the state of its filter.
STATE = tuple(f"{name}_{axis}" for name in ("v", "bw", "ba") for axis in "xyz")


def read(path: Path, _options: NoOptions) -> Imported:
    """The poses of a file of `ns, x, y, z, qw, qx, qy, qz` (m), under a header that starts with #.

    Raises:
        DataError: no such file, nothing in it, a line with more or fewer columns, a value that is
            no number, and as `vrbench.recording.checks.imported_poses`.
    """
    lines, repairs = whole_lines(path, fix=told(COLUMNS))
    headers = 0
    while headers < len(lines) and lines[headers].startswith("#"):
        headers += 1
    rows = lines[headers:]
    if not rows:
        raise DataError("holds no poses", file=path, fix=told(COLUMNS))
    wide = rows[0].count(",") + 1 == len(COLUMNS) + len(STATE)
    t, values = parse_columns(
        rows,
        COLUMNS + STATE if wide else COLUMNS,
        stamp="timestamp",
        values=XYZW,
        file=path,
        first_line=headers + 1,
    )
    return imported_poses(t, values[:, :3], values[:, 3:], file=path, repairs=repairs)


IMPORTER = Importer(name="euroc", title="EuRoC CSV: ns, x, y, z, qw, qx, qy, qz (m)", read=read)
