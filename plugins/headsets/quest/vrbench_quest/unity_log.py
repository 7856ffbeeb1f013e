"""The CSV log of the paper's Unity app: 16 columns, no header, one line a frame.

    local_ticks, utc_ticks, year, month, day, hour, minute, second, ms, x, y, z, qx, qy, qz, qw

Of the time columns only `utc_ticks` is used: local time differs between devices, and the calendar
columns end at milliseconds. Ticks are 100 ns since 0001-01-01; as floats they would lose digits.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

from vrbench.errors import DataError
from vrbench.geometry import Transform, unity_to_openxr
from vrbench.recording.checks import imported_poses
from vrbench.recording.importer import Imported, Importer, NoOptions
from vrbench.recording.text_table import Lines, filled_lines, parse_columns, told

TIME = ("local_ticks", "utc_ticks", "year", "month", "day", "hour", "minute", "second", "ms")
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
COLUMNS = TIME + POSE

DECIMAL_COMMAS = "numbers with a decimal comma read as such"
SEMICOLONS = "columns split at semicolons"

TICK_NS = 100
TICKS_A_SECOND = 10_000_000
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
    lines = filled_lines(path, fix=told(COLUMNS))
    rows, more = _with_decimal_points(lines, path)
    ticks, pose = parse_columns(
        rows, COLUMNS, stamp="utc_ticks", values=POSE, file=path, numbers=lines.numbers
    )
    _check_calendar(rows[0], lines.numbers[0], path)
    eye = unity_to_openxr(Transform(pose[:, :3], pose[:, 3:]))
    t = (ticks - TICKS_AT_1970) * TICK_NS
    row = "line" if lines.numbers[-1] == len(rows) else "pose"
    return imported_poses(t, eye.p, eye.q, file=path, row=row, repairs=(*lines.repairs, *more))


def _with_decimal_points(lines: Lines, path: Path) -> tuple[list[str], tuple[str, ...]]:
    """Their text as written on a headset whose language has a decimal point, and what was changed.

    With a decimal comma a number takes two of the columns: seven numbers, 23 columns. A frame
    whose numbers are all whole (the first ones may be) has 16 in any language.
    """
    text = lines.text
    if ";" in text[0]:
        return [line.replace(",", ".").replace(";", ",") for line in text], (SEMICOLONS,)
    plain, merged = len(COLUMNS) - 1, len(COLUMNS) - 1 + len(POSE)
    counts = [line.count(",") for line in text]
    if merged not in counts or any("." in line for line in text):
        return text, ()
    mended = []
    for number, line, count in zip(lines.numbers, text, counts, strict=True):
        if count not in (plain, merged):
            raise DataError(
                f"has {count + 1} columns: its decimal commas can't be told from its separators",
                file=path,
                field=f"line {number}",
                fix="remove the line, or log with a decimal point",
            )
        fields = line.split(",")
        first, rest = fields[: len(TIME)], fields[len(TIME) :]
        pairs = zip(rest[::2], rest[1::2], strict=True) if count == merged else ()
        mended.append(",".join([*first, *(map(".".join, pairs) if pairs else rest)]))
    return mended, (DECIMAL_COMMAS,)


def _check_calendar(line: str, number: int, path: Path) -> None:
    """Refuses a log whose second column isn't the time that its calendar columns tell."""
    fields = line.split(",")
    ticks = int(fields[1])
    try:
        year, month, day, hour, minute, second, ms = map(int, fields[2:9])
        calendar = datetime(year, month, day, hour, minute, second, ms * 1000, tzinfo=UTC)
    except (ValueError, OverflowError):
        calendar = None
    if calendar is not None:
        since = calendar - datetime(1970, 1, 1, tzinfo=UTC)
        if abs(ticks - TICKS_AT_1970 - 10 * (since // timedelta(microseconds=1))) < TICKS_A_SECOND:
            return
    raise DataError(
        f"{ticks} is not the time {' '.join(fields[2:9])} in ticks",
        file=path,
        field=f"line {number}, column 2 (utc_ticks)",
        fix="100 ns since 0001-01-01, UTC; is this the paper's Unity log?",
    )


IMPORTER = Importer(
    name="quest-unity-csv",
    title="CSV of the paper's Unity app: centre eye, 16 columns, UTC ticks",
    read=read,
)
