"""A column map: any text of a pose a line, where the recordings file says what the columns are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from vrbench.errors import DataError
from vrbench.geometry import Axes, Transform
from vrbench.recording.checks import imported_poses
from vrbench.recording.importer import Imported, Importer
from vrbench.recording.text_table import filled_lines, parse_fields, told
from vrbench.trajectory import NS

Column = str | int
DELIMITERS = {",": ",", ";": ";", "tab": "\t", "space": None}
LENGTHS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}
TIMES_NS = {"s": NS, "ms": 1_000_000, "us": 1_000, "ticks": 100, "utc-ticks": 100, "ns": 1}
# .NET's DateTime counts from the year 1.
ORIGINS = {"utc-ticks": 621_355_968_000_000_000}
# Forward, where it isn't given: as OpenXR, Unity, ROS and Unreal have it.
FORWARD = {("y", "right"): "-z", ("y", "left"): "z", ("z", "right"): "x", ("z", "left"): "x"}
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]


class CsvOptions(BaseModel):
    """What the columns of a text file are.

    Columns are named as in the file's header, or counted from 1 where it has none.

    Attributes:
        time: the column of stamps.
        position: the three columns of x, y, z.
        quaternion: the four columns of the rotation, in `quaternion_order`.
        quaternion_order: `xyzw` or `wxyz`.
        time_unit: `s`, `ms`, `us`, `ns`, `ticks` of 100 ns, or `utc-ticks`: those since the year 1,
            as Unity's and .NET's `DateTime.UtcNow.Ticks`.
        position_unit: `m`, `cm`, `mm`.
        handedness: `right` or `left`.
        up: the axis against gravity.
        forward: the axis of sight; OpenXR's, Unity's, ROS's or Unreal's where not given.
        delimiter: `,`, `;`, `tab`, or `space` for any run of blanks.
        decimal: the decimal sign.
        skip: lines at the top to pass by, besides blank ones and those that start with `#`.
    """

    model_config = ConfigDict(extra="forbid")

    time: Column
    position: tuple[Column, Column, Column]
    quaternion: tuple[Column, Column, Column, Column]
    quaternion_order: Literal["xyzw", "wxyz"] = "xyzw"
    time_unit: Literal["s", "ms", "us", "ns", "ticks", "utc-ticks"] = "s"
    position_unit: Literal["m", "cm", "mm"] = "m"
    handedness: Literal["right", "left"] = "right"
    up: Axis = "y"
    forward: Axis | None = None
    delimiter: Literal[",", ";", "tab", "space"] = ","
    decimal: Literal[".", ","] = "."
    skip: int = Field(0, ge=0)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Time, x, y, z, and the quaternion in its order."""
        return (self.time, *self.position, *self.quaternion)

    @property
    def axes(self) -> Axes:
        """The file's convention."""
        forward = self.forward or FORWARD.get((self.up, self.handedness), "")
        return Axes(self.up, forward, self.handedness, LENGTHS_M[self.position_unit])

    @model_validator(mode="after")
    def _consistent(self) -> CsvOptions:
        if len({type(column) for column in self.columns}) > 1:
            raise ValueError("columns are all names, or all numbers counted from 1")
        if len(set(self.columns)) < len(self.columns):
            raise ValueError("a column is named twice")
        if any(isinstance(column, int) and column < 1 for column in self.columns):
            raise ValueError("columns are counted from 1")
        if self.delimiter == self.decimal:
            raise ValueError("the delimiter and the decimal sign are both ,")
        if self.forward is None and (self.up, self.handedness) not in FORWARD:
            raise ValueError(f"with up {self.up}, say which axis is forward")
        self.axes  # noqa: B018  # raises where up and forward are one line
        return self


def read(path: Path, options: CsvOptions) -> Imported:
    """The poses of a text file, in OpenXR's convention.

    Raises:
        DataError: no such file, nothing in it, a column that isn't there, a line with more or
            fewer columns, a value that is no number, and as
            `vrbench.recording.checks.imported_poses`.
    """
    lines = filled_lines(path, fix="lines of numbers, a pose each")
    delimiter = DELIMITERS[options.delimiter]
    rows, numbers = [], []
    for number, line in zip(lines.numbers, lines.text, strict=True):
        if number > options.skip and not line.startswith("#"):
            rows.append([field.strip().strip('"') for field in line.split(delimiter)])
            numbers.append(number)
    named = isinstance(options.time, str)
    if len(rows) <= named:
        raise DataError("holds no poses", file=path, fix="lines of numbers, a pose each")
    names = [str(number) for number in range(1, len(rows[0]) + 1)]
    if named:
        names = rows.pop(0)
        numbers.pop(0)
    if options.decimal == ",":
        rows = [[field.replace(",", ".") for field in row] for row in rows]
    wanted = [_found(str(column), names, path) for column in options.columns]
    t, values = parse_fields(
        rows,
        names,
        stamp=wanted[0],
        values=wanted[1:],
        unit_ns=TIMES_NS[options.time_unit],
        origin=ORIGINS.get(options.time_unit, 0),
        file=path,
        numbers=numbers,
    )
    turn = [3, 4, 5, 6] if options.quaternion_order == "xyzw" else [4, 5, 6, 3]
    pose = options.axes.to_openxr(Transform(values[:, :3], values[:, turn]))
    return imported_poses(t, pose.p, pose.q, file=path, repairs=lines.repairs)


def _found(column: str, names: Sequence[str], path: Path) -> str:
    """The name of a column, which the file must have once."""
    if names.count(column) != 1:
        many = "no" if column not in names else "more than one"
        raise DataError(f"has {many} column {column!r}", file=path, fix=told(names))
    return column


IMPORTER = Importer(
    name="csv",
    title="Any text of a pose a line; the recordings file maps its columns",
    read=read,
    options=CsvOptions,
)
