"""C3D: markers only, to which a rigid body is fitted; needs the extra `c3d` (ezc3d)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from vrbench.errors import ConfigError, DataError
from vrbench.geometry import Z_UP, Floats, Transform
from vrbench.recording.checks import imported_poses, with_invalid
from vrbench.recording.file_time import StartOptions, start_ns
from vrbench.recording.importer import Imported, Importer
from vrbench.recording.marker_body import fit_body
from vrbench.trajectory import NS

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}


class Options(StartOptions):
    """Keys of the format.

    Attributes:
        markers: labels of the body's markers; all where not given.
        up: the axis that is up in the file.
        tolerance_mm: largest rms of a frame's markers about the body's shape.
    """

    markers: list[str] | None = Field(None, min_length=3)
    up: Literal["y", "z"] = "z"
    tolerance_mm: float = Field(2.0, gt=0.0)


def read(path: Path, options: Options) -> Imported:
    """The poses of the body that carries the markers, `T_mocap_body`, y up.

    Raises:
        ConfigError: ezc3d isn't installed.
        DataError: no such file, no C3D, no such markers, no rigid body, and as
            `vrbench.recording.checks.imported_poses`.
    """
    content = _load(path)
    point = content["parameters"].get("POINT", {})
    labels = [str(label) for label in _values(point, "LABELS")]
    unit = str((_values(point, "UNITS") or ["mm"])[0]).strip()
    if unit.lower() not in UNITS_M:
        raise DataError(
            f"{unit!r} isn't a known unit", file=path, field="POINT:UNITS", fix=", ".join(UNITS_M)
        )
    rate = float(content["header"]["points"]["frame_rate"])
    if not rate > 0:
        raise DataError(f"the rate is {rate:g} Hz", file=path, field="POINT:RATE")
    columns = _columns(labels, options.markers, path)
    markers = _positions(content, columns) * UNITS_M[unit.lower()]
    if options.up == "z":
        markers = Z_UP.points_to_openxr(markers)
    body = fit_body(markers, tolerance_m=options.tolerance_mm * 1e-3, file=path)
    start, assumed = start_ns(None, options, file=path)
    first = int(content["header"]["points"]["first_frame"])
    frames = first + np.arange(len(markers))
    t = start + np.rint(frames / rate * NS).astype(np.int64)
    seen = body.seen
    pose: Transform = body.pose[seen]
    found = imported_poses(t[seen], pose.p, pose.q, file=path, row="seen frame", repairs=assumed)
    return with_invalid(replace(found, markers=body.shape), t[~seen])


def _load(path: Path) -> Any:
    try:
        import ezc3d
    except ImportError:
        raise ConfigError(
            "reading C3D needs ezc3d", file=path, fix="pip install 'vrbench[c3d]'"
        ) from None
    if not path.is_file():
        raise DataError("no such file", file=path)
    try:
        return ezc3d.c3d(str(path))
    except Exception as error:  # a damaged file breaks the library in any place
        raise DataError(f"can't be read as C3D: {error}", file=path) from error


def _values(group: Any, name: str) -> list[Any]:
    """A parameter's values; past 255 of them a file goes on in NAME2, NAME3, ..."""
    values: list[Any] = []
    for key in (name, *(f"{name}{i}" for i in range(2, 20))):
        if key not in group:
            break
        values += list(group[key]["value"])
    return values


def _columns(labels: list[str], wanted: list[str] | None, path: Path) -> list[int]:
    if wanted is None:
        return list(range(len(labels)))
    missing = [label for label in wanted if label not in labels]
    if missing:
        raise DataError(
            f"has no marker {', '.join(missing)}",
            file=path,
            field="markers",
            fix=f"there are {', '.join(labels) or 'none'}",
        )
    return [labels.index(label) for label in wanted]


def _positions(content: Any, columns: list[int]) -> Floats:
    """Markers (n, k, 3) in the file's unit; NaN where one wasn't seen."""
    points = np.asarray(content["data"]["points"], dtype=np.float64)
    positions = np.moveaxis(points[:3, columns], (0, 1, 2), (2, 1, 0)).copy()
    residuals = np.asarray(content["data"]["meta_points"]["residuals"], dtype=np.float64)
    positions[residuals[0, columns].T < 0.0] = np.nan
    return positions


IMPORTER = Importer(
    name="c3d",
    title="C3D: a rigid body fitted to its markers (extra c3d)",
    read=read,
    options=Options,
)
