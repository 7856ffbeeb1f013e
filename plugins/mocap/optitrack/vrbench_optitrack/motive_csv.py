"""Motive's CSV exports, 1.20 to 1.25: the poses of one rigid body.

    Format Version,1.23,Take Name,...,Rotation Type,Quaternion,Length Units,Meters,...

    ,Type,Rigid Body,Rigid Body,...
    ,Name,headset,headset,...
    ,ID,"9D1F...",...
    ,,Rotation,Rotation,...,Position,Position,...
    Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,...

Rows are found by what stands in them, for versions differ in how many there are. Times are rounded
to a millisecond in the file, so frames are counted at the export's rate instead.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import Field

from vrbench.errors import DataError
from vrbench.geometry import Floats, Ints, Transform
from vrbench.recording.checks import imported_poses, with_invalid
from vrbench.recording.file_time import StartOptions, local_time, start_ns
from vrbench.recording.importer import Imported, Importer
from vrbench.recording.text_table import whole_lines
from vrbench.trajectory import NS
from vrbench_optitrack.axes import Up, pose_to_y_up, to_y_up

WHAT = "a CSV export of Motive, with rigid bodies"
UNITS_M = {
    "meters": 1.0,
    "centimeters": 0.01,
    "millimeters": 0.001,
    "inches": 0.0254,
    "feet": 0.3048,
}
ORDERS = {"XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"}
LABELS = ("Type", "Name", "ID", "Parent")
RIGID_BODY, BODY_MARKER = "rigid body", "rigid body marker"
AXES = "XYZ"
LOOKED_AT = 1000
"""In so many frames, evenly over the take, markers are looked at."""


class Options(StartOptions):
    """Keys of the format.

    Attributes:
        body: the rigid body's name; not needed where the file has one only.
        up: the axis that was up in the export.
    """

    body: str | None = Field(None, min_length=1)
    up: Up = "y"


@dataclass(frozen=True, slots=True)
class _Head:
    """What stands above the data.

    Attributes:
        facts: of the first line, by name.
        rows: cells of the labelled rows, by label; and `kind`, `axis`.
        end: number of the line of column names.
    """

    facts: Mapping[str, str]
    rows: Mapping[str, Sequence[str]]
    end: int


def read(path: Path, options: Options) -> Imported:
    """The poses of a body, `T_mocap_body`, y up; where it was lost, a sample is invalid.

    Raises:
        DataError: no such file, no export of Motive, no such body, an unknown unit or rotation
            type, a value that is no number, and as `vrbench.recording.checks.imported_poses`.
    """
    lines, repairs = whole_lines(path, fix=WHAT)
    head = _head(lines, path)
    scale, order = _scale(head, path), _order(head, path)
    body = _body(head, options.body, path)
    columns, marked = _columns(head, body, order, path), _marker_columns(head, body)
    frames, seconds, cells = _values(lines, head, [*columns, *marked], path)
    values, markers = np.split(cells, [len(columns)], axis=1)
    began = local_time(head.facts.get("Capture Start Time", ""))
    start, assumed = start_ns(began, options, file=path)
    t = start + np.rint(frames / _rate(head, frames, seconds, path) * NS).astype(np.int64)
    seen = ~np.isnan(values).any(axis=1)
    if not seen.any():
        raise DataError("the body is seen in no frame", file=path, field=options.body)
    turns = values[seen, 3:]
    q = turns if order is None else _from_euler(order, turns)
    pose = pose_to_y_up(Transform(values[seen, :3] * scale, q), options.up)
    said = (*repairs, *assumed)
    found = imported_poses(t[seen], pose.p, pose.q, file=path, row="seen frame", repairs=said)
    spots = markers[seen].reshape(int(seen.sum()), -1, 3) * scale
    offsets = _offsets(spots, pose, options.up) if marked else None
    return with_invalid(replace(found, markers=offsets), t[~seen])


def _head(lines: Sequence[str], path: Path) -> _Head:
    cells = _cells(lines[0])
    facts = dict(zip(cells[::2], cells[1::2], strict=False))
    if "Format Version" not in facts:
        raise DataError("isn't an export of Motive", file=path, field="line 1", fix=WHAT)
    rows: dict[str, Sequence[str]] = {}
    before: Sequence[str] = ()
    for number, line in enumerate(lines[1:40], 2):
        cells = _cells(line)
        if cells and cells[0] == "Frame":
            return _Head(facts, {**rows, "kind": before, "axis": cells}, number)
        if len(cells) > 1 and cells[1] in LABELS:
            rows[cells[1]] = cells
        before = cells if any(cells) else before
    raise DataError("has no line of column names, `Frame,Time (Seconds),...`", file=path, fix=WHAT)


def _cells(line: str) -> list[str]:
    try:
        cells = next(csv.reader([line]), [])
    except csv.Error:  # damaged: what comes of it is refused further on
        cells = line.split(",")
    return [cell.strip() for cell in cells]


def _body(head: _Head, wanted: str | None, path: Path) -> str:
    """The body that is meant."""
    types, names = head.rows.get("Type", ()), head.rows.get("Name", ())
    bodies = dict.fromkeys(
        name
        for kind, name in zip(types, names, strict=False)
        if kind.lower() == RIGID_BODY and name
    )
    if not bodies:
        there = sorted({kind for kind in types[2:] if kind})
        raise DataError(
            "has no rigid body",
            file=path,
            fix=f"it has {', '.join(there) or 'nothing'}: export again with Rigid Bodies on",
        )
    if wanted is None and len(bodies) == 1:
        return next(iter(bodies))
    if wanted not in bodies:
        what = "several bodies: which one is meant?" if wanted is None else f"no body {wanted!r}"
        raise DataError(
            f"has {what}", file=path, field="body", fix=f"there are {', '.join(bodies)}"
        )
    return wanted


def _columns(head: _Head, body: str, order: str | None, path: Path) -> list[int]:
    """The columns of x, y, z and of the rotation, in our order."""
    found: dict[tuple[str, str], int] = {}
    rows = (head.rows[key] for key in ("Type", "Name", "kind", "axis"))
    for column, (kind, name, what, axis) in enumerate(zip(*rows, strict=False)):
        if kind.lower() == RIGID_BODY and name == body:
            found.setdefault((what, axis), column)
    wanted = [("Position", axis) for axis in "XYZ"]
    wanted += [("Rotation", axis) for axis in (order or "XYZW")]
    missing = [f"{what} {axis}" for what, axis in wanted if (what, axis) not in found]
    if missing:
        raise DataError(f"body {body!r} has no column {', '.join(missing)}", file=path, fix=WHAT)
    return [found[each] for each in wanted]


def _marker_columns(head: _Head, body: str) -> list[int]:
    """The columns of x, y, z of each marker that Motive takes to be on the body."""
    found: dict[str, dict[str, int]] = {}
    rows = (head.rows[key] for key in ("Type", "Name", "kind", "axis"))
    for column, (kind, name, what, axis) in enumerate(zip(*rows, strict=False)):
        ours = kind.lower() == BODY_MARKER and name.startswith(f"{body}:")
        if ours and what == "Position" and axis in AXES:
            found.setdefault(name, {}).setdefault(axis, column)
    whole = [found[name] for name in sorted(found) if len(found[name]) == len(AXES)]
    return [columns[axis] for columns in whole for axis in AXES]


def _offsets(markers: Floats, pose: Transform, up: Up) -> Floats | None:
    """Where markers (n, k, 3) [m] sit from the pivot (k, 3) [m], y up; None if one never is."""
    rows = np.unique(np.linspace(0, len(markers) - 1, LOOKED_AT).astype(np.int64))
    away = pose[rows].inverse()[:, None].apply(to_y_up(markers[rows], up))
    seen = ~np.isnan(away).any(axis=2)
    if not seen.any(axis=0).all():
        return None
    return np.nanmedian(away, axis=0)


def _scale(head: _Head, path: Path) -> float:
    """The file's unit of length [m]."""
    unit = head.facts.get("Length Units", "")
    if unit.lower() not in UNITS_M:
        raise DataError(
            f"{unit!r} isn't a known unit",
            file=path,
            field="Length Units",
            fix=f"{', '.join(UNITS_M)}",
        )
    if head.facts.get("Coordinate Space", "Global").lower() != "global":
        raise DataError(
            f"poses are {head.facts['Coordinate Space']}",
            file=path,
            field="Coordinate Space",
            fix="export them in Global coordinates",
        )
    return UNITS_M[unit.lower()]


def _order(head: _Head, path: Path) -> str | None:
    """The order of intrinsic Euler angles, as scipy names it; None for quaternions."""
    kind = head.facts.get("Rotation Type", "").removesuffix("Euler").rstrip()
    if kind.lower() == "quaternion":
        return None
    if kind.upper() not in ORDERS:
        raise DataError(
            f"{kind!r} isn't a known rotation type",
            file=path,
            field="Rotation Type",
            fix=f"Quaternion, or the order of Euler angles: {', '.join(sorted(ORDERS))}",
        )
    return kind.upper()


def _from_euler(order: str, angles_deg: Floats) -> Floats:
    """Quaternions (n, 4) of intrinsic Euler angles (n, 3) [deg], in that order."""
    from scipy.spatial.transform import Rotation  # listing plugins needs no scipy

    return Rotation.from_euler(order, angles_deg, degrees=True).as_quat()


def _values(
    lines: Sequence[str], head: _Head, columns: Sequence[int], path: Path
) -> tuple[Ints, Floats, Floats]:
    """Frame numbers (n,), times (n,) [s], values (n, k); NaN where a cell is blank."""
    frames, seconds, values = [], [], []
    for number, line in enumerate(lines[head.end :], head.end + 1):
        cells = line.split(",")
        if not any(cells):
            continue
        try:
            frames.append(int(cells[0]))
            seconds.append(float(cells[1]))
            # a row may end where its last cells are blank
            picked = [cells[c].strip() if c < len(cells) else "" for c in columns]
            values.append([float(cell) if cell else float("nan") for cell in picked])
        except (ValueError, IndexError, OverflowError):
            raise DataError(
                "has a cell that is no number", file=path, field=f"line {number}", fix=WHAT
            ) from None
    if not frames:
        raise DataError("holds no frames", file=path, fix=WHAT)
    if max(map(abs, frames)) > 10**12:
        raise DataError(f"counts to frame {max(frames)}", file=path, field="Frame")
    return np.array(frames), np.array(seconds), np.array(values)


def _rate(head: _Head, frames: Ints, seconds: Floats, path: Path) -> float:
    """The rate that frames are counted at: the one that agrees with the times in the file."""
    rates = []
    for name in ("Export Frame Rate", "Capture Frame Rate"):
        try:
            rates.append(float(head.facts.get(name, "")))
        except ValueError:
            continue
    rates = [rate for rate in rates if 0 < rate < 1e5]
    for rate in rates:
        # rounded to a millisecond, by versions that round down, too
        if np.abs((seconds - seconds[0]) - (frames - frames[0]) / rate).max() < 2.1e-3:
            return rate
    told = ", ".join(f"{rate:g}" for rate in rates) or "none"
    raise DataError(
        f"frames and times agree with no frame rate it gives: {told}",
        file=path,
        field="Export Frame Rate",
    )


IMPORTER = Importer(
    name="motive-csv",
    title="CSV export of OptiTrack Motive, 1.20 to 1.25: a rigid body",
    read=read,
    options=Options,
)
