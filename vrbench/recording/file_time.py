"""When a file of motion capture began: its stamps count from there.

Public to the authors of plugins. Such files give local time without a zone, or none at all.
"""

from __future__ import annotations

import re
from datetime import datetime
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from vrbench.errors import DataError
from vrbench.trajectory import NS

UTC_OFFSET = r"^[+-]\d{2}:\d{2}$"


class StartOptions(BaseModel):
    """Keys of formats whose time needs telling.

    Attributes:
        start: when frame 0 was taken, ISO 8601 with its zone; instead of what the file says.
        utc_offset: of the local time that the file gives.
    """

    model_config = ConfigDict(extra="forbid")

    start: str | None = Field(
        None, description="when frame 0 was taken, ISO 8601 with its zone; else as the file says"
    )
    utc_offset: str | None = Field(
        None, pattern=UTC_OFFSET, description="of the local time that the file gives: +01:00"
    )


def start_ns(
    said: datetime | None, options: StartOptions, *, file: Path
) -> tuple[int, tuple[str, ...]]:
    """The time of frame 0 [ns since 1970], and what had to be assumed, a sentence each.

    Args:
        said: local time that the file gives, without a zone; None where it gives none.
        options: of the rig's author.
        file: named in errors.

    Raises:
        DataError: `start` isn't a time with a zone.
    """
    if options.start is not None:
        try:
            start = datetime.fromisoformat(options.start)
        except ValueError:
            start = None
        if start is None or start.tzinfo is None:
            raise DataError(
                f"{options.start!r} is not a time with its zone",
                file=file,
                field="start",
                fix="as 2024-01-31T13:00:50.693+01:00",
            )
        return _ns(start), ()
    if said is None:
        return 0, ("the file gives no time of day: stamps count from 0; `start` gives it",)
    zone = options.utc_offset or "+00:00"
    zoned = datetime.fromisoformat(f"{said.isoformat()}{zone}")
    if options.utc_offset is not None:
        return _ns(zoned), ()
    return _ns(zoned), (
        f"the start, {said.isoformat(sep=' ')}, has no zone and is taken for UTC; `utc_offset` "
        "gives it",
    )


def local_time(text: str) -> datetime | None:
    """A local time as programs write it, `2023-11-28 10.27.58.765 PM`; None where it is none.

    Separators don't matter. Before noon and after are told by AM and PM in English and some other
    languages; any other word behind the time makes it None, for it may mean either.
    """
    match = re.match(
        r"^\s*(\d{4})[-./](\d{1,2})[-./](\d{1,2})[ T,]+(\d{1,2})[.:](\d{2})[.:](\d{2})"
        r"(?:[.,:](\d{1,6}))?\s*(\S*)\s*$",
        text,
    )
    if match is None:
        return None
    year, month, day, hour, minute, second = map(int, match.groups()[:6])
    word = match[8].replace(".", "").lower()
    if word in PM or word in AM:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + 12 * (word in PM)
    elif word:
        return None
    try:
        fraction = int((match[7] or "0").ljust(6, "0"))
        return datetime(year, month, day, hour, minute, second, fraction)
    except ValueError:
        return None


AM = {"am", "de", "vm", "πμ", "上午", "午前", "오전"}
PM = {"pm", "du", "nm", "μμ", "下午", "午後", "오후"}


def _ns(time: datetime) -> int:
    whole = int(time.replace(microsecond=0).timestamp())
    return whole * NS + time.microsecond * 1000
