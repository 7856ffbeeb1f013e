"""CSV of Duke I3T's XR_Tracking_Evaluation: `t x y z qx qy qz qw` (s, m), by commas or blanks.

Its apps write what their engine has: Unity's (Quest, HoloLens, Magic Leap) a left-handed frame by
commas, the Vision Pro's ARKit a right-handed one by blanks, the motion-capture logger ROS's. The
file itself doesn't say, so the recordings file has to, or OpenXR's is taken and said.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from vrbench.errors import DataError
from vrbench.geometry import OPENXR, ROS, UNITY, Transform
from vrbench.recording.checks import imported_poses
from vrbench.recording.importer import Imported, Importer
from vrbench.recording.text_table import parse_fields, told, whole_lines
from vrbench.trajectory import NS

COLUMNS = ("timestamp", "x", "y", "z", "qx", "qy", "qz", "qw")
AXES = {"unity": UNITY, "openxr": OPENXR, "ros": ROS}


class DukeOptions(BaseModel):
    """What the file doesn't say of itself.

    Attributes:
        axes: `unity`, `openxr` (ARKit too) or `ros` (Vicon); OpenXR's where not given.
    """

    model_config = ConfigDict(extra="forbid")

    axes: Literal["unity", "openxr", "ros"] | None = None


def read(path: Path, options: DukeOptions) -> Imported:
    """The poses of a log, in OpenXR's convention.

    Raises:
        DataError: no such file, nothing in it, a line with more or fewer columns, a value that is
            no number, and as `vrbench.recording.checks.imported_poses`.
    """
    lines, repairs = whole_lines(path, fix=told(COLUMNS))
    by_comma = "," in lines[0]
    rows = [
        [x.strip() for x in line.split(",")] if by_comma else line.split()
        for line in (line.lstrip("# ") for line in lines)
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
        first_line=1 + header,
    )
    if options.axes is None:
        repairs = (*repairs, "axes taken to be OpenXR's: the file doesn't say, nor does `axes`")
    pose = AXES[options.axes or "openxr"].to_openxr(Transform(values[:, :3], values[:, 3:]))
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
    options=DukeOptions,
)
