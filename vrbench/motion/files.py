"""Motion files: TUM rows of `T_eye0_eye` (m, s from 0) under a YAML header in comment lines.

    # motion: seated-shooter
    # version: 1
    # up: y
    # rate_hz: 120.0
    # source: captured
    # licence: CC-BY-4.0
    # consent: written, for publication
    0.000000000 0.0 0.0 0.0 0.0 0.0 0.0 1.0

So any program that reads TUM reads the rows. A captured motion is a person's: without a licence and
the person's consent it is refused.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationError,
    model_validator,
)

from vrbench.errors import ConfigError, DataError
from vrbench.geometry import Z_UP, Transform, relative_angle
from vrbench.motion.motion import Motion, relative_to_first
from vrbench.text_file import replace_text
from vrbench.trajectory import NS, Trajectory, checked_trajectory, read_tum, tum_text

Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]
NOTHING = {"none", "no", "unknown", "n/a", "-", "?", "tbd", "todo"}
RATE_TOLERANCE = 0.02
START_TOLERANCE = 1e-6
# A seated player moves within 0.6 m at 0.9 m/s, one who walks a room within some metres.
LARGEST_BOX_M, LARGEST_SPEED_M_S = 20.0, 10.0
HEAD_BOX_M = (0.1, 3.0)
# A robot would go through a hole in a straight line, which is no part of the motion.
LONGEST_HOLE_S = 0.1


class Header(BaseModel):
    """What a motion file says of itself.

    Attributes:
        motion: its name.
        version: of the motion: another one moves otherwise.
        up: the axis that is up.
        rate_hz: of its rows [Hz].
        source: `generated`, `captured`, or how it was had.
        game: what was played.
        posture: seated, standing.
        licence: under which it may be used; a person's motion needs one.
        consent: how the person agreed to its publication; a person's motion needs it.
    """

    model_config = ConfigDict(extra="forbid")

    motion: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]*$")
    version: int = Field(ge=1)
    up: Literal["y", "z"]
    rate_hz: float = Field(gt=0.0)
    source: Text
    game: Text | None = None
    posture: Text | None = None
    licence: Text | None = None
    consent: Text | None = None

    @model_validator(mode="after")
    def _permitted(self) -> Header:
        if self.source == "generated":
            return self
        for name in ("licence", "consent"):
            if not given(getattr(self, name)):
                raise ValueError(f"a person's motion needs {name}: say what was agreed")
        return self

    @property
    def name(self) -> str:
        """Name and version, `seated-shooter-1`."""
        return f"{self.motion}-{self.version}"


def given(text: str | None) -> bool:
    """Whether a licence or consent says anything."""
    return text is not None and text.strip().lower() not in NOTHING | {""}


def read_motion(path: Path) -> Motion:
    """A motion file, y up.

    Raises:
        ConfigError: a field of the header is missing, unknown or wrong; a person's motion has no
            licence or consent.
        DataError: no such file, and as `vrbench.trajectory.read_tum`; the rows don't begin at 0
            with the identity, haven't the rate that the header says, or have holes or leaps.
    """
    return _checked(read_header(path), read_tum(path), path)


def _checked(header: Header, rows: Trajectory, path: Path) -> Motion:
    """The motion that a file's header and rows make; errors as `read_motion`."""
    if len(rows) < 2 or rows.t[0] != 0:
        raise DataError("its rows don't begin at 0 s, or are fewer than two", file=path)
    _check_frame(rows.pose[0], path)
    rate = 1.0 / rows.period_s
    if abs(rate / header.rate_hz - 1.0) > RATE_TOLERANCE:
        unit = _time_unit(header.rate_hz / rate)
        raise DataError(
            f"its rows have {rate:.4g} Hz, its header says {header.rate_hz:g}",
            file=path,
            field="rate_hz",
            fix=f"its stamps look like {unit}; they are in s" if unit else None,
        )
    _check_size(rows, path)
    _check_steps(rows, path)
    if header.up == "z":
        rows = rows.mapped(Z_UP.to_openxr)
    title = ", ".join(x for x in (header.motion, header.game, header.posture) if x)
    return Motion(header.name, title, rows, header.source)


def _check_frame(first: Transform, path: Path) -> None:
    """The first pose is the identity: anything else is in some frame of its own."""
    turned = float(relative_angle(first.q, np.array([0.0, 0.0, 0.0, 1.0])))
    away = float(np.linalg.norm(first.p))
    if max(away, turned) <= START_TOLERANCE:
        return
    if abs(abs(first.q[0]) - 1.0) < START_TOLERANCE and away <= START_TOLERANCE:
        raise DataError(
            "its first quaternion is 1 0 0 0: a half turn, or w written first",
            file=path,
            fix="the order is qx qy qz qw",
        )
    raise DataError(
        f"its first pose isn't the identity: {away:.3g} m and {np.degrees(turned):.3g} deg from it",
        file=path,
        fix="poses are of the eye, relative to the first (T_eye0_eye), not in a room or world: "
        "`vrbench motion extract` writes such files",
    )


def _time_unit(factor: float) -> str | None:
    """The unit that stamps have which are so many times too large; None where it is no unit's."""
    units = {1e-3: "ks", 1e3: "ms", 1e6: "us", 1e9: "ns", 1.0 / 60.0: "min"}
    return next((u for f, u in units.items() if abs(factor / f - 1.0) < RATE_TOLERANCE), None)


def _check_size(rows: Trajectory, path: Path) -> None:
    """A head moves within a few metres, at a few metres a second: all else is another unit."""
    box = float(np.max(rows.pose.p.max(axis=0) - rows.pose.p.min(axis=0)))
    fast = float(np.percentile(rows.speed(), 99))
    if box > LARGEST_BOX_M or fast > LARGEST_SPEED_M_S:
        low, high = HEAD_BOX_M
        guess = " or ".join(u for f, u in ((1e2, "cm"), (1e3, "mm")) if low <= box / f <= high)
        raise DataError(
            f"it moves within {box:.3g} m, at up to {fast:.3g} m/s: that is no head's motion",
            file=path,
            fix="positions are in m" + (f"; these look like {guess}" if guess else ""),
        )


def _check_steps(rows: Trajectory, path: Path) -> None:
    """Rows follow each other without holes and leaps."""
    hole, leap = np.diff(rows.t) / NS, rows.speed()
    wide, far = int(np.argmax(hole)), int(np.argmax(leap))
    if hole[wide] > max(LONGEST_HOLE_S, 2.0 * rows.period_s):
        raise DataError(
            f"has no rows for {hole[wide]:.3g} s after {rows.t[wide] / NS:.3f} s",
            file=path,
            fix="choose a part without holes: `vrbench motion extract` does",
        )
    if leap[far] > LARGEST_SPEED_M_S:
        raise DataError(
            f"leaps at {leap[far]:.3g} m/s after {rows.t[far] / NS:.3f} s",
            file=path,
            fix="choose a part in which tracking holds, without recentring",
        )


def has_header(path: Path) -> bool:
    """Whether a TUM file is a motion file: one of its first comment lines names the motion."""
    try:
        with path.open(encoding="utf-8") as file:
            for line in file:
                if not line.startswith("#"):
                    return False
                if line[1:].strip().startswith("motion:"):
                    return True
    except (OSError, UnicodeDecodeError):
        pass
    return False


def read_header(path: Path) -> Header:
    """A motion file's header alone; errors as `read_motion`."""
    lines = []
    try:
        with path.open(encoding="utf-8") as file:
            for line in file:
                if not line.startswith("#"):
                    break
                lines.append(line[1:].removeprefix(" "))
    except (OSError, UnicodeDecodeError) as error:
        raise DataError("can't be read", file=path, fix=str(error)) from error
    try:
        content = yaml.safe_load("".join(lines))
    except yaml.YAMLError as error:
        raise ConfigError(f"its header is not YAML: {error}", file=path) from None
    if not isinstance(content, dict):
        raise ConfigError(
            "has no header", file=path, fix=f"comment lines with {', '.join(Header.model_fields)}"
        )
    try:
        return Header.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ConfigError(
            first["msg"].removeprefix("Value error, "),
            file=path,
            field=".".join(map(str, first["loc"])) or None,
            fix=f"fields are {', '.join(Header.model_fields)}",
        ) from None


def write_motion(path: Path, header: Header, trajectory: Trajectory) -> Motion:
    """Writes poses, `T_world_eye` with y up, as a motion file relative to the first of them.

    Its folder is made. Nothing is written of a motion that would be refused when it is read.

    Returns:
        the motion as it reads back.

    Raises:
        ConfigError: the file is there already.
        DataError: as `read_motion`: the poses haven't the header's rate, or have holes or leaps.
    """
    if path.exists():
        raise ConfigError("is there already", file=path, fix="name a file that is not")
    rows = relative_to_first(trajectory)
    motion = _checked(header, checked_trajectory(rows.t, rows.pose.p, rows.pose.q, path), path)
    content = header.model_dump(exclude_none=True)
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    head = "".join(f"# {line}\n" for line in text.splitlines())
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_text(path, head + tum_text(rows))
    return motion


def resampled(trajectory: Trajectory, rate_hz: float, *, max_gap_s: float) -> Trajectory:
    """The trajectory at an even rate.

    Raises:
        DataError: a gap is longer than `max_gap_s`; says where.
    """
    steps = np.diff(trajectory.t) / NS
    wide = np.flatnonzero(steps > max_gap_s)
    if len(wide):
        at = (trajectory.t[wide[0]] - trajectory.t[0]) / NS
        raise DataError(
            f"{len(wide)} gaps, the first of {steps[wide[0]]:.2f} s after {at:.2f} s",
            fix=f"choose a part without gaps over {max_gap_s:g} s",
        )
    count = int((trajectory.t[-1] - trajectory.t[0]) / NS * rate_hz) + 1
    t = trajectory.t[0] + np.rint(np.arange(count) / rate_hz * NS).astype(np.int64)
    t = t[t <= trajectory.t[-1]]
    return Trajectory(t, trajectory.at(t))
