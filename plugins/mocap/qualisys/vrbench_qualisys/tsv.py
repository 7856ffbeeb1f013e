"""QTM's 6DOF export as TSV: the poses of one rigid body, in mm.

    FREQUENCY  100
    TIME_STAMP  2020-01-22, 17:47:17  22107.99
    BODY_NAMES  headset  controller
    Frame  Time  headset X  Y  Z  Roll  Pitch  Yaw  Residual  Rot[0]  ...  Rot[8]  controller X ...

Rows are found by what stands in them. The rotation matrix is read, and not the Euler angles, whose
convention each project of QTM defines for itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import Field

from vrbench.errors import DataError
from vrbench.geometry import Floats
from vrbench.recording.checks import imported_poses, with_invalid
from vrbench.recording.file_time import StartOptions, local_time, start_ns
from vrbench.recording.importer import Imported, Importer
from vrbench.recording.text_table import whole_lines
from vrbench.trajectory import NS
from vrbench_qualisys.axes import Up, is_rotation, poses_of, to_y_up

WHAT = "a 6DOF export of QTM as TSV, with rotation matrices"
POSE = ("X", "Y", "Z", *(f"Rot[{i}]" for i in range(9)))


class Options(StartOptions):
    """Keys of the format.

    Attributes:
        body: the rigid body's name; not needed where the file has one only.
        up: the axis that is up in QTM.
    """

    body: str | None = Field(None, min_length=1, description="the rigid body's name in QTM")
    up: Up = Field("z", description="the axis that is up in QTM")


def read(path: Path, options: Options) -> Imported:
    """The poses of a body, `T_mocap_body`, y up; where it was lost, a sample is invalid.

    Raises:
        DataError: no such file, no export of QTM, no such body, a value that is no number, and as
            `vrbench.recording.checks.imported_poses`.
    """
    lines, repairs = whole_lines(path, fix=WHAT)
    facts: dict[str, list[str]] = {}
    for line in lines:
        cells = [cell.strip() for cell in line.split("\t")]
        if any(cell.endswith(("Rot[0]", " X")) for cell in cells):
            break
        facts[cells[0]] = cells[1:]
    else:
        raise DataError("has no line of column names", file=path, fix=WHAT)
    names = [name for name in facts.get("BODY_NAMES", []) if name]
    body = _body(names, options.body, path)
    columns = _columns(cells, names, body, path)
    above = lines.index(line) + 1
    values = _values(lines[above:], above, columns, path)
    rate = _rate(facts, path)
    stamp = local_time(" ".join(facts.get("TIME_STAMP", [])[:1]))
    start, assumed = start_ns(stamp, options, file=path)
    t = start + np.rint(np.arange(len(values)) / rate * NS).astype(np.int64)
    seen = is_rotation(values[:, 3:]) & np.isfinite(values[:, :3]).all(axis=1)
    if not seen.any():
        raise DataError("the body is seen in no frame", file=path, field=body)
    pose = to_y_up(poses_of(values[seen, :3], values[seen, 3:]), options.up)
    repairs = (*repairs, *assumed)
    found = imported_poses(t[seen], pose.p, pose.q, file=path, row="seen frame", repairs=repairs)
    return with_invalid(found, t[~seen])


def _body(names: Sequence[str], wanted: str | None, path: Path) -> str:
    if wanted is None and len(names) == 1:
        return names[0]
    if wanted is None or wanted not in names:
        what = "which body is meant?" if wanted is None else f"has no body {wanted!r}"
        told = ", ".join(names) or "none"
        raise DataError(what, file=path, field="body", fix=f"there are {told}")
    return wanted


def _columns(cells: Sequence[str], names: Sequence[str], body: str, path: Path) -> list[int]:
    """Columns of X, Y, Z and the matrix: each body's begin with `<name> X`."""
    starts = [i for i, cell in enumerate(cells) if cell == "X" or cell.endswith(" X")]
    titled = [cells[i].removesuffix("X").strip() for i in starts]
    if body in titled:
        first = starts[titled.index(body)]
    elif len(starts) == len(names):
        first = starts[list(names).index(body)]
    else:
        raise DataError(f"no column {body} X", file=path, fix=WHAT)
    end = min([i for i in starts if i > first], default=len(cells))
    own = [cell.split(" ")[-1] for cell in cells[first:end]]
    missing = [name for name in POSE if name not in own]
    if missing:
        raise DataError(f"body {body!r} has no column {', '.join(missing)}", file=path, fix=WHAT)
    return [first + own.index(name) for name in POSE]


def _values(lines: Sequence[str], above: int, columns: Sequence[int], path: Path) -> Floats:
    """Values (n, k); NaN where a cell is blank."""
    rows = []
    for number, line in enumerate(lines, above + 1):
        cells = line.split("\t")
        try:
            picked = [cells[c].strip() if c < len(cells) else "" for c in columns]
            rows.append([float(cell) if cell else float("nan") for cell in picked])
        except ValueError:
            raise DataError(
                "has a cell that is no number", file=path, field=f"line {number}", fix=WHAT
            ) from None
    if not rows:
        raise DataError("holds no frames", file=path, fix=WHAT)
    return np.array(rows)


def _rate(facts: dict[str, list[str]], path: Path) -> float:
    try:
        rate = float(facts["FREQUENCY"][0])
    except (KeyError, IndexError, ValueError):
        rate = 0.0
    if not 0 < rate < 1e5:
        raise DataError("gives no rate", file=path, field="FREQUENCY", fix=WHAT)
    return rate


IMPORTER = Importer(
    name="qtm-6d-tsv",
    title="6DOF export of Qualisys QTM as TSV: a rigid body",
    read=read,
    options=Options,
)
