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
from vrbench.recording.checks import increasing
from vrbench.recording.importer import Imported, Importer
from vrbench.recording.text_table import Lines, filled_lines, parse_fields, told
from vrbench.streams import GOOD, Samples, believed

KIND = "# vrbench-log "
VERSION = "1"
FIRST = KIND + VERSION
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
COLUMNS = (
    *("time_ns", "frame", "moment"),
    *POSE,
    *("vx", "vy", "vz", "wx", "wy", "wz"),
    *("flags", "present", "epoch"),
)
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
    lines = _lines(path)
    origin = _origin(lines, path)
    rows, numbers = [], []
    for number, line in _below_names(lines, path):
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
    wanted = (*POSE, "flags", "epoch")
    t, values = parse_fields(
        rows, COLUMNS, stamp="time_ns", values=wanted, unit_ns=1, file=path, numbers=numbers
    )
    samples, told_good = _samples(t, values, origin, path)
    repairs = lines.repairs
    if len(samples) < len(t):
        dropped = len(t) - len(samples)
        repairs = (*repairs, f"{dropped} samples dropped, whose stamps repeat or go back")
    lost, wrong = len(samples) - told_good, told_good - int(samples.good.sum())
    if lost:
        repairs = (*repairs, f"{lost} samples are not tracked, as the headset says")
    if wrong:
        repairs = (*repairs, f"{wrong} samples called tracked are no poses, and not taken as such")
    return Imported(samples, repairs)


def facts_of(path: Path) -> dict[str, str]:
    """What the header says of device and app, text by name."""
    return _facts(_lines(path))


def _lines(path: Path) -> Lines:
    lines = filled_lines(path, fix=f"the first line is `{FIRST}`")
    first = lines.text[0].strip()
    if first.startswith(KIND) and first != FIRST:
        raise DataError(
            f"is a log of version {first.removeprefix(KIND)}",
            file=path,
            fix=f"version {VERSION} is read: update vrbench-quest, or the logger",
        )
    if first != FIRST:
        raise DataError(
            "is not a log of vrbench's Unity logger", file=path, fix=f"it starts with `{FIRST}`"
        )
    return lines


def _below_names(lines: Lines, path: Path) -> list[tuple[int, str]]:
    """The lines of samples, with their numbers: those below the names of the columns."""
    numbered = [
        (number, line)
        for number, line in zip(lines.numbers, lines.text, strict=True)
        if not line.startswith("#")
    ]
    names = tuple(numbered[0][1].split(",")) if numbered else ()
    if names != COLUMNS:
        others = [x for x in names if x not in COLUMNS] or [x for x in COLUMNS if x not in names]
        raise DataError(
            f"has other columns: {', '.join(others) or 'in another order'}",
            file=path,
            field=f"line {numbered[0][0]}" if numbered else "",
            fix=told(COLUMNS),
        )
    return numbered[1:]


def _facts(lines: Lines) -> dict[str, str]:
    facts = {}
    for line in lines.text[1:]:
        if not line.startswith("#"):
            break
        key, colon, value = line[1:].partition(":")
        if colon:
            facts[key.strip()] = value.strip()
    return facts


def _origin(lines: Lines, path: Path) -> int:
    """UTC [ns] where the monotonic clock is 0."""
    text = _facts(lines).get(ORIGIN, "")
    if not text.lstrip("-").isdigit() or abs(int(text)) > 2**62:
        raise DataError(
            f"the header's {ORIGIN} is {text!r}", file=path, fix="UTC at the clock's 0, whole ns"
        )
    return int(text)


def _samples(t: Ints, values: Floats, origin: int, path: Path) -> tuple[Samples, int]:
    """The samples, and how many of them the headset calls good."""
    keep = increasing(t, file=path, row="sample")
    t, values = t[keep], values[keep]
    bounds = np.array([GOOD, 2**32 - 1])
    bad = np.flatnonzero(
        ~((values[:, 7:] >= 0) & (values[:, 7:] <= bounds)).all(axis=1)
        | (values[:, 7:] % 1 != 0).any(axis=1)
    )
    if len(bad):
        raise DataError(f"flags or epoch of sample {bad[0] + 1} are none", file=path)
    # what was no pose live is none in the log either
    checked, flags = believed(values[:, :3], values[:, 3:7], values[:, 7])
    eye = UNITY.to_openxr(checked)
    pose_t = t + np.int64(origin)
    samples = Samples(
        source_t=t,
        pose_t=pose_t,
        receive_t=pose_t,
        pose=Transform(eye.p, continuous_signs(eye.q)),
        flags=flags,
        epoch=values[:, 8].astype(np.uint32),
    )
    return samples, int(np.sum(values[:, 7] == GOOD))


IMPORTER = Importer(
    name="quest-vrbench-csv",
    title="Log of vrbench's own Unity logger: monotonic clock, flags, epochs",
    read=read,
    options=LogOptions,
)
