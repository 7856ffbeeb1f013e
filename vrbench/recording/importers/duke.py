"""CSV of Duke I3T's XR_Tracking_Evaluation: `t x y z qx qy qz qw` (s, m), by commas or blanks.

Its apps write what their engine has: Unity's (Quest, HoloLens, Magic Leap) a left-handed frame by
commas, the Vision Pro's ARKit a right-handed one by blanks, the motion-capture logger ROS's. The
file itself doesn't say, so the recordings file has to, or OpenXR's is taken and said.
"""

from __future__ import annotations

from pathlib import Path

from vrbench.errors import DataError
from vrbench.geometry import Transform
from vrbench.recording.checks import imported_poses
from vrbench.recording.importer import AxesOptions, Imported, Importer
from vrbench.recording.text_table import filled_lines, parse_fields, told
from vrbench.trajectory import NS

COLUMNS = ("timestamp", "x", "y", "z", "qx", "qy", "qz", "qw")


def read(path: Path, options: AxesOptions) -> Imported:
    """The poses of a log, in OpenXR's convention.

    Raises:
        DataError: no such file, nothing in it, a line with more or fewer columns, a value that is
            no number, and as `vrbench.recording.checks.imported_poses`.
    """
    lines = filled_lines(path, fix=told(COLUMNS))
    by_comma = "," in lines.text[0]
    rows = [
        [x.strip() for x in line.split(",")] if by_comma else line.split()
        for line in (line.lstrip("# ") for line in lines.text)
    ]
    header = not _is_number(rows[0][0] if rows[0] else "")
    if len(rows) <= header:
        raise DataError("holds no poses", file=path, fix=told(COLUMNS))
    t, values = parse_fields(
        rows[header:],
        COLUMNS,
        stamp="timestamp",
        values=COLUMNS[1:],
        unit_ns=NS,
        file=path,
        numbers=lines.numbers[header:],
    )
    repairs = lines.repairs
    if options.axes is None:
        repairs = (*repairs, "axes taken to be OpenXR's: the file doesn't say, nor does `axes`")
    pose = options.to_openxr(Transform(values[:, :3], values[:, 3:]))
    return imported_poses(t, pose.p, pose.q, file=path, repairs=repairs)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


IMPORTER = Importer(
    name="duke",
    title="CSV of Duke's XR_Tracking_Evaluation: t x y z qx qy qz qw (s, m)",
    read=read,
    options=AxesOptions,
)
