"""The log of the Unity logger: a header that says what it is, a line a sample.

# vrbench-log 1
# key: value                           facts of device and app
time_ns,frame,moment,x,...,epoch       names of the columns
12345678,1,render,0.1,...,0
# event 12345678 recentre ...          what happened, among the samples
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from vrbench.errors import DataError
from vrbench.geometry import UNITY, Floats, Ints, Transform, continuous_signs
from vrbench.recording.checks import checked_poses, increasing
from vrbench.recording.importer import Imported, Importer
from vrbench.recording.text_table import parse_fields, told, whole_lines
from vrbench.streams import GOOD, Flag, Samples

FIRST = "# vrbench-log 1"
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
COLUMNS = (
    *("time_ns", "frame", "moment"),
    *POSE,
    *("vx", "vy", "vz", "wx", "wy", "wz"),
    *("flags", "present", "epoch"),
)
VALID = Flag.ORIENTATION_VALID | Flag.POSITION_VALID
ORIGIN = "utc_origin_ns"


class LogOptions(BaseModel):
    """Which samples of the log are meant.

    Attributes:
        moment: poses as in Update, or those right before rendering.
    """

    model_config = ConfigDict(extra="forbid")

    moment: Literal["update", "render"] = "render"


def read(path: Path, options: LogOptions) -> Imported:
    """The poses of the centre eye, `T_world_eye` in OpenXR's convention.

    Source time is the headset's monotonic clock; pose time is the same carried on from the UTC
    that the header gives, so that a clock set during the take doesn't matter.

    Raises:
        DataError: no such file, another kind of log, a line with more or fewer columns, a value
            that is no number, no sample of the moment, and as in `vrbench.recording.checks`.
    """
    lines, repairs = whole_lines(path, fix=f"the first line is `{FIRST}`")
    if lines[0].strip() != FIRST:
        raise DataError(
            "is not a log of vrbench's Unity logger", file=path, fix=f"it starts with `{FIRST}`"
        )
    origin = _origin(lines, path)
    numbered = [(n, line) for n, line in enumerate(lines, 1) if line and not line.startswith("#")]
    if not numbered or tuple(numbered[0][1].split(",")) != COLUMNS:
        raise DataError("has other columns", file=path, fix=told(COLUMNS))
    rows, numbers = [], []
    for number, line in numbered[1:]:
        fields = line.split(",")
        if len(fields) != len(COLUMNS):
            raise DataError(
                f"has {len(fields)} columns", file=path, field=f"line {number}", fix=told(COLUMNS)
            )
        if fields[2] == options.moment:
            rows.append(fields)
            numbers.append(number)
    if not rows:
        raise DataError(f"holds no samples of the moment {options.moment}", file=path)
    t, values = _parsed(rows, numbers, path)
    samples = _samples(t, values, origin, path)
    if len(samples) < len(t):
        dropped = len(t) - len(samples)
        repairs = (*repairs, f"{dropped} samples dropped, whose stamps repeat or go back")
    bad = int(np.sum(~samples.good))
    if bad:
        repairs = (*repairs, f"{bad} samples are not tracked, as the headset says")
    return Imported(samples, repairs)


def facts_of(path: Path) -> dict[str, str]:
    """What the header says of device and app, text by name."""
    lines, _ = whole_lines(path, fix=f"the first line is `{FIRST}`")
    return _facts(lines)


def _facts(lines: list[str]) -> dict[str, str]:
    facts = {}
    for line in lines[1:]:
        if not line.startswith("#"):
            break
        key, colon, value = line[1:].partition(":")
        if colon:
            facts[key.strip()] = value.strip()
    return facts


def _origin(lines: list[str], path: Path) -> int:
    """UTC [ns] where the monotonic clock is 0."""
    text = _facts(lines).get(ORIGIN, "")
    if not text.lstrip("-").isdigit() or abs(int(text)) > 2**62:
        raise DataError(
            f"the header's {ORIGIN} is {text!r}", file=path, fix="UTC at the clock's 0, whole ns"
        )
    return int(text)


def _parsed(rows: list[list[str]], numbers: list[int], path: Path) -> tuple[Ints, Floats]:
    """Times [ns], and pose, flags and epoch (n, 9)."""
    wanted = (*POSE, "flags", "epoch")
    try:
        return parse_fields(rows, COLUMNS, stamp="time_ns", values=wanted, unit_ns=1, file=path)
    except DataError as error:
        # rows are samples of one moment: say which line of the file it is
        word, _, rest = (error.field or "").partition(" ")
        row, _, column = rest.partition(",")
        place = f"line {numbers[int(row) - 1]},{column}" if word == "line" else error.field
        raise DataError(error.what, file=path, field=place, fix=error.fix) from None


def _samples(t: Ints, values: Floats, origin: int, path: Path) -> Samples:
    keep = increasing(t, file=path, row="sample")
    t, values = t[keep], values[keep]
    bounds = np.array([GOOD, 2**32 - 1])
    bad = np.flatnonzero(
        ~((values[:, 7:] >= 0) & (values[:, 7:] <= bounds)).all(axis=1)
        | (values[:, 7:] % 1 != 0).any(axis=1)
    )
    if len(bad):
        raise DataError(f"flags or epoch of sample {bad[0] + 1} are none", file=path)
    flags = values[:, 7].astype(np.uint32)
    valid = (flags & VALID) == VALID
    # what the headset itself calls no pose isn't held against the file
    p = np.where(valid[:, None], values[:, :3], 0.0)
    q = np.where(valid[:, None], values[:, 3:7], [0.0, 0.0, 0.0, 1.0])
    flags = np.where(valid, flags, 0).astype(np.uint32)
    checked = checked_poses(p, q, file=path, row="sample")
    eye = UNITY.to_openxr(checked)
    pose_t = t + np.int64(origin)
    return Samples(
        source_t=t,
        pose_t=pose_t,
        receive_t=pose_t,
        pose=Transform(eye.p, continuous_signs(eye.q)),
        flags=flags,
        epoch=values[:, 8].astype(np.uint32),
    )


IMPORTER = Importer(
    name="quest-vrbench-csv",
    title="Log of vrbench's own Unity logger: monotonic clock, flags, epochs",
    read=read,
    options=LogOptions,
)
