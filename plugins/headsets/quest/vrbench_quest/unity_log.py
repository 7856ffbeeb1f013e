"""The CSV log of the paper's Unity app: 16 columns, no header, one line a frame.

    local_ticks, utc_ticks, year, month, day, hour, minute, second, ms, x, y, z, qx, qy, qz, qw

Of the time columns only `utc_ticks` is used: local time differs between devices, and the calendar
columns end at milliseconds. Ticks are 100 ns since 0001-01-01; as floats they would lose digits.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from vrbench.errors import DataError
from vrbench.geometry import Floats, Ints, Transform, unity_to_openxr
from vrbench.recording.checks import imported_poses
from vrbench.recording.importer import Imported, Importer, NoOptions

COLUMNS = (
    *("local_ticks", "utc_ticks", "year", "month", "day", "hour", "minute", "second", "ms"),
    *("x", "y", "z", "qx", "qy", "qz", "qw"),
)
UTC_TICKS = 1
POSE = tuple(range(9, 16))
ROW = [("ticks", np.int64), ("pose", np.float64, len(POSE))]
FIX = f"{len(COLUMNS)} columns: {', '.join(COLUMNS)}"

TICK_NS = 100
TICKS_AT_1970 = 621_355_968_000_000_000


def read(path: Path, _options: NoOptions) -> Imported:
    """The poses of the centre eye, `T_world_eye` in OpenXR's convention, stamped in UTC [ns].

    A last line without its newline is left out, for its last number may have lost digits. Jumps,
    as where the robot brakes, are kept: what is scored is decided by the reference alone.

    Raises:
        DataError: no such file, nothing in it, a line with more or fewer columns, a value that is
            no number, a second column that isn't UTC ticks, and as
            `vrbench.recording.checks.imported_poses`.
    """
    lines, repairs = _whole_lines(path)
    lines, more = _with_decimal_points(lines, path)
    for number, line in enumerate(lines, 1):
        if line.count(",") != len(COLUMNS) - 1:
            raise DataError(
                f"has {line.count(',') + 1} columns", file=path, field=f"line {number}", fix=FIX
            )
    ticks, pose = _parse(lines, path)
    _check_calendar(lines[0], path)
    eye = unity_to_openxr(Transform(pose[:, :3], pose[:, 3:]))
    t = (ticks - TICKS_AT_1970) * TICK_NS
    return imported_poses(t, eye.p, eye.q, file=path, row="line", repairs=(*repairs, *more))


def _whole_lines(path: Path) -> tuple[list[str], tuple[str, ...]]:
    """The lines that end in a newline, and what was left out."""
    try:
        text = path.read_bytes().decode("utf-8-sig", errors="replace")
    except OSError as error:
        raise DataError("can't be read", file=path, fix=error.strerror) from error
    if not text.strip():
        raise DataError("is empty", file=path, fix=FIX)
    whole, _, rest = text.rpartition("\n")
    if not whole.strip():
        raise DataError("holds no whole line: the only one has no newline", file=path, fix=FIX)
    lines = [line.rstrip("\r") for line in whole.rstrip("\r\n").split("\n")]
    if not rest.strip():
        return lines, ()
    return lines, (f"line {whole.count(chr(10)) + 2} left out: the file ends in the midst of it",)


def _with_decimal_points(lines: list[str], path: Path) -> tuple[list[str], tuple[str, ...]]:
    """The lines as written on a headset whose language has a decimal point, and what was changed.

    With a decimal comma a number takes two of the columns: seven numbers, 23 columns. A frame
    whose numbers are all whole (the first ones may be) has 16 in any language.
    """
    said = ("numbers with a decimal comma read as such",)
    if ";" in lines[0]:
        return [line.replace(",", ".").replace(";", ",") for line in lines], said
    plain, merged = len(COLUMNS) - 1, len(COLUMNS) - 1 + len(POSE)
    counts = [line.count(",") for line in lines]
    if max(counts) <= plain or any("." in line for line in lines):
        return lines, ()
    if merged not in counts:
        return lines, ()
    mended = []
    for number, (line, count) in enumerate(zip(lines, counts, strict=True), 1):
        if count not in (plain, merged):
            raise DataError(
                f"has {count + 1} columns: its decimal commas can't be told from its separators",
                file=path,
                field=f"line {number}",
                fix="remove the line, or log with a decimal point",
            )
        fields = line.split(",")
        first, rest = fields[: POSE[0]], fields[POSE[0] :]
        pairs = zip(rest[::2], rest[1::2], strict=True) if count == merged else ()
        mended.append(",".join([*first, *(map(".".join, pairs) if pairs else rest)]))
    return mended, said


def _parse(lines: list[str], path: Path) -> tuple[Ints, Floats]:
    """UTC ticks (n,) and `x y z qx qy qz qw` (n, 7) of lines of 16 columns."""
    try:
        with warnings.catch_warnings():
            # numpy before 2 reads "1.5" as the integer 1, and only warns
            warnings.simplefilter("error", DeprecationWarning)
            rows = np.loadtxt(
                lines,
                dtype=ROW,
                delimiter=",",
                usecols=(UTC_TICKS, *POSE),
                comments=None,
                ndmin=1,
            )
    except (ValueError, DeprecationWarning) as error:
        raise _bad_value(lines, path) or DataError(str(error), file=path, fix=FIX) from error
    return rows["ticks"], rows["pose"]


def _bad_value(lines: list[str], path: Path) -> DataError | None:
    """An error that names the first value that is no number."""
    parsers: dict[int, Callable[[str], object]] = {
        UTC_TICKS: np.int64,
        **dict.fromkeys(POSE, float),
    }
    for number, line in enumerate(lines, 1):
        fields = line.split(",")
        for column, parse in parsers.items():
            try:
                parse(fields[column])
            except (ValueError, OverflowError):
                kind = "a whole number" if column == UTC_TICKS else "a number"
                return DataError(
                    f"{fields[column]!r} is not {kind}",
                    file=path,
                    field=f"line {number}, column {column + 1} ({COLUMNS[column]})",
                )
    return None


def _check_calendar(line: str, path: Path) -> None:
    """Refuses a log whose second column isn't the time that its calendar columns tell."""
    fields = line.split(",")
    try:
        *day_and_time, ms = map(int, fields[2:9])
        year, month, day, hour, minute, second = day_and_time
        told = datetime(year, month, day, hour, minute, second, ms * 1000, tzinfo=UTC)
    except (ValueError, OverflowError):
        told = None
    ticks = int(fields[UTC_TICKS])
    if told is not None:
        since = told - datetime(1970, 1, 1, tzinfo=UTC)
        if abs(ticks - TICKS_AT_1970 - since // timedelta(microseconds=1) * 10) < 10_000_000:
            return
    raise DataError(
        f"{fields[UTC_TICKS]} is not the time {' '.join(fields[2:9])} in ticks",
        file=path,
        field=f"line 1, column {UTC_TICKS + 1} ({COLUMNS[UTC_TICKS]})",
        fix="100 ns since 0001-01-01, UTC; is this the paper's Unity log?",
    )


IMPORTER = Importer(
    name="quest-unity-csv",
    title="CSV of the paper's Unity app: centre eye, 16 columns, UTC ticks",
    read=read,
)
