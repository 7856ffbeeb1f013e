"""What page and recorder say to each other, checked: see PROTOCOL.md.

Text messages are JSON objects with a `type`; binary ones are batches of frames.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from vrbench.devices.frames import CALLBACK, COLUMNS, EPOCH, FLAGS, NOW
from vrbench.geometry import Floats

VERSION = 1
MAX_MESSAGE_BYTES = 1 << 20
MAX_TEXT_CHARS = 1 << 14
MAX_ROWS = 4096
HEADER = 4
# Sequence numbers, epochs and times are whole or real numbers that float64 holds exactly.
LARGEST = 2.0**53
# Milliseconds since 1970 until 2096, and of a clock counted from there 31 years: in nanoseconds
# their sum stays within int64.
LATEST_ORIGIN_MS = 4e12
LATEST_MS = 1e12

# Why a connection is closed, told to the page.
SECOND_CLIENT = 4001
BAD_MESSAGE = 4002
OTHER_VERSION = 4003
REPLACED = 4004

Name = Annotated[str, Field(max_length=100)]
Milliseconds = Annotated[float, Field(ge=-LATEST_MS, le=LATEST_MS, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=2**53)]


class ProtocolError(Exception):
    """A message is not what the protocol says."""


class _Message(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, strict=True)


class Hello(_Message):
    """The first message of a page. `page` is drawn anew each time the page is loaded."""

    type: Literal["hello"]
    protocol: int
    page: Annotated[str, Field(min_length=8, max_length=64)]
    origin_ms: Annotated[float, Field(ge=0, le=LATEST_ORIGIN_MS, allow_inf_nan=False)]
    client: Name = "page"
    agent: Annotated[str, Field(max_length=500)] = ""
    isolated: bool = False
    webxr: bool = True
    reason: Annotated[str, Field(max_length=300)] = ""


class State(_Message):
    """What a person at the PC wants to know; sent when it changes and once a second."""

    type: Literal["state"]
    session: bool
    mode: Name = ""
    space: Name = ""
    visibility: Name = ""
    features: Annotated[list[Name], Field(max_length=64)] = []
    rate_hz: Annotated[float, Field(ge=0, le=10_000, allow_inf_nan=False)] | None = None
    view: Annotated[list[float], Field(min_length=7, max_length=7)] | None = None
    held: Count = 0
    dropped: Count = 0


class PageEvent(_Message):
    """Something that happened on the headset; sent again until it is acknowledged."""

    type: Literal["event"]
    id: Count
    kind: Literal["reset", "visibility", "session-start", "session-end", "rate", "note"]
    now_ms: Milliseconds
    detail: dict[str, str | float | int | bool | None] = {}


class Pong(_Message):
    """The answer to a ping, with the page's times of its receipt and of this answer."""

    type: Literal["pong"]
    id: Count
    received_ms: Milliseconds
    sent_ms: Milliseconds


FromPage = Hello | State | PageEvent | Pong
_ADAPTER: TypeAdapter[FromPage] = TypeAdapter(Annotated[FromPage, Field(discriminator="type")])


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Frames in sequence.

    Attributes:
        first: sequence number of the first.
        rows: `COLUMNS` of each (n, 18).
    """

    first: int
    rows: Floats


def parse_text(text: str) -> FromPage:
    """A text message.

    Raises:
        ProtocolError: too long, not JSON, of no known type, of another shape.
    """
    if len(text) > MAX_TEXT_CHARS:
        raise ProtocolError(f"a text message of {len(text)} characters")
    try:
        return _ADAPTER.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ProtocolError(f"{where or 'message'}: {first['msg']}") from None


def parse_batch(data: bytes) -> Batch:
    """A binary message: float64, little-endian: version, first number, rows, columns; the rows.

    Raises:
        ProtocolError: another length than the header says, numbers that are none, flags or epochs
            out of their range.
    """
    if len(data) % 8 or len(data) < 8 * HEADER:
        raise ProtocolError(f"a batch of {len(data)} bytes")
    values = np.frombuffer(data, "<f8")
    version, first, count, columns = values[:HEADER].tolist()
    if version != VERSION or columns != len(COLUMNS):
        raise ProtocolError(f"a batch of version {version:g} with {columns:g} columns")
    if not (0 <= first < LARGEST and first == int(first)):
        raise ProtocolError(f"sequence number {first:g}")
    if not (1 <= count <= MAX_ROWS) or len(values) != HEADER + count * len(COLUMNS):
        raise ProtocolError(f"{count:g} frames in {len(data)} bytes")
    rows = values[HEADER:].reshape(-1, len(COLUMNS)).copy()
    times, ends = rows[:, [CALLBACK, NOW]], rows[:, [FLAGS, EPOCH]]
    if not (np.isfinite(times).all() and (np.abs(times) < LATEST_MS).all()):
        raise ProtocolError("a frame without its times")
    if not ((ends >= 0) & (ends < [16, 2**32]) & (ends == np.floor(ends))).all():
        raise ProtocolError("flags or epoch of a frame")
    return Batch(int(first), rows)


def message(kind: str, **fields: Any) -> str:
    """A text message to the page."""
    return json.dumps({"type": kind, **fields})
