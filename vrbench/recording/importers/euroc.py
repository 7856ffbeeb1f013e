"""EuRoC CSV, as Monado and the EuRoC ground truth write it: nanoseconds, quaternions w first."""

from __future__ import annotations

from pathlib import Path

from vrbench.errors import DataError
from vrbench.geometry import Transform
from vrbench.recording.checks import imported_poses
from vrbench.recording.importer import AxesOptions, Imported, Importer
from vrbench.recording.text_table import filled_lines, parse_columns, told

COLUMNS = ("timestamp", "x", "y", "z", "qw", "qx", "qy", "qz")
XYZW = ("x", "y", "z", "qx", "qy", "qz", "qw")
# The data set's own ground truth goes on with the state of its filter.
STATE = tuple(f"{name}_{axis}" for name in ("v", "bw", "ba") for axis in "xyz")


def read(path: Path, options: AxesOptions) -> Imported:
    """The poses of a file of `ns, x, y, z, qw, qx, qy, qz` (m), under a header that starts with #.

    Raises:
        DataError: no such file, nothing in it, a line with more or fewer columns, a value that is
            no number, and as `vrbench.recording.checks.imported_poses`.
    """
    lines = filled_lines(path, fix=told(COLUMNS))
    headers = 0
    while headers < len(lines.text) and lines.text[headers].startswith("#"):
        headers += 1
    rows = lines[headers:]
    if not rows.text:
        raise DataError("holds no poses", file=path, fix=told(COLUMNS))
    wide = rows.text[0].count(",") + 1 == len(COLUMNS) + len(STATE)
    t, values = parse_columns(
        rows.text,
        COLUMNS + STATE if wide else COLUMNS,
        stamp="timestamp",
        values=XYZW,
        file=path,
        numbers=rows.numbers,
    )
    pose = options.to_openxr(Transform(values[:, :3], values[:, 3:]))
    return imported_poses(t, pose.p, pose.q, file=path, repairs=lines.repairs)


IMPORTER = Importer(
    name="euroc",
    title="EuRoC CSV: ns, x, y, z, qw, qx, qy, qz (m)",
    read=read,
    options=AxesOptions,
)
