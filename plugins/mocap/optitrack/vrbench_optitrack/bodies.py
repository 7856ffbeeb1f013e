"""A frame's rigid bodies and times alone, quickly: what a source reads of every frame."""

from __future__ import annotations

import struct
from typing import Any

from vrbench_optitrack.frame import UNSAID, BodyFrame, BodyRow
from vrbench_optitrack.layout import (
    BODY,
    BODY_ERROR,
    BODY_ERROR_PARAMS,
    BODY_START,
    Layout,
    error_params,
    layout_of,
    strided,
    suffix_of,
)
from vrbench_optitrack.wire import (
    HEADER,
    INT,
    PAIR,
    Message,
    NatNetError,
    Reader,
    Version,
    reader_of,
)


def decode_bodies(packet: bytes, version: Version) -> BodyFrame:
    """A frame's rigid bodies and times; all else is stepped over.

    Raises:
        NatNetError: no frame of this version, to the byte.
    """
    layout = layout_of(version)
    if not layout.sized:
        return _bodies_hurried(packet, layout) or _bodies_walked(packet, layout)
    end = len(packet)
    message, size = HEADER.unpack_from(packet) if end >= 4 else (-1, 0)
    if message != Message.FRAME or size + 4 != end or end < 8:
        reader_of(packet, Message.FRAME)
        raise NatNetError(4, "a frame without a number")
    last = end - 8
    at = 8
    bodies: list[Any] = []
    for section in range(8):
        if at > last:
            raise NatNetError(at, "the frame ends before its last section")
        count, size = PAIR.unpack_from(packet, at)
        start = at + 8
        at = start + size
        if size < 0 or count < 0 or at > end or count > size or (size and not count):
            raise NatNetError(start - 8, f"a section of {count} items in {size} bytes")
        if section == 2 and count:
            if size == 38 * count:
                bodies = list(BODY.iter_unpack(packet[start:at]))
            else:
                bodies = strided(packet, start, count, size, BODY, layout)
    return BodyFrame(INT.unpack_from(packet, 4)[0], bodies, suffix_of(packet, at, layout))


def _bodies_hurried(packet: bytes, layout: Layout) -> BodyFrame | None:
    """As `_bodies_walked`, at 40 % of its time; None where anything is amiss: that says what.

    A frame of 10 bodies and 100 markers takes 6 to 9 us, not 15 to 23 (`benchmarks/decode.py`).
    """
    integer, tail = INT.unpack_from, layout.tail
    end = len(packet)
    if end < 8 or HEADER.unpack_from(packet) != (Message.FRAME, end - 4):
        return None
    try:
        at = 12
        for _ in range(integer(packet, 8)[0]):
            at = packet.index(b"\0", at) + 1
            n = integer(packet, at)[0]
            if n < 0:
                return None
            at += 4 + 12 * n
        n = integer(packet, at)[0]
        start = at + 8 + 12 * n
        count = integer(packet, start - 4)[0]
        if n < 0 or count < 0 or start + 32 * count > end:
            return None
        rows: list[Any] = []
        if layout.body_markers:
            at = start
            for _ in range(count):
                n = integer(packet, at + 32)[0]
                if n < 0:
                    return None
                head = BODY_START.unpack_from(packet, at)
                at += 36 + 20 * n
                if layout.body_params:
                    rows.append(head + BODY_ERROR_PARAMS.unpack_from(packet, at))
                    at += 6
                else:
                    rows.append((*head, *BODY_ERROR.unpack_from(packet, at), UNSAID))
                    at += 4
        else:
            at = start + 38 * count
            rows = list(BODY.iter_unpack(packet[start:at]))
        if integer(packet, at)[0]:
            return None  # skeletons: rare
        n = integer(packet, at + 4)[0]
        if n < 0:
            return None
        at += 8 + n * layout.marker.size
        for _ in range(layout.plates + layout.devices):
            if integer(packet, at)[0]:
                return None  # force plates, devices: rare
            at += 4
    except (struct.error, ValueError):
        return None
    if end - at != tail.layout.size:
        return None
    return BodyFrame(integer(packet, 4)[0], rows, tail.suffix(*tail.layout.unpack_from(packet, at)))


def _bodies_walked(packet: bytes, layout: Layout) -> BodyFrame:
    """As `decode_bodies`, where sections don't say their size."""
    r = reader_of(packet, Message.FRAME)
    number = r.integer("the frame's number")
    for _ in range(r.count(5, "marker sets")):
        r.text("a marker set's name")
        r.skip(12, "markers of a set")
    r.skip(12, "other markers")
    bodies = _body_rows(r, layout)
    for _ in range(r.count(8, "skeletons")):
        r.integer("a skeleton's id")
        _body_rows(r, layout)
    size = layout.marker.size
    r.skip(size, "labeled markers")
    for there, what in ((layout.plates, "force plates"), (layout.devices, "devices")):
        for _ in range(r.count(8, what) if there else 0):
            r.integer("an id")
            for _ in range(r.count(4, "channels")):
                r.skip(4, "values")
    return BodyFrame(number, bodies, suffix_of(packet, r.at, layout))


def _body_rows(r: Reader, layout: Layout) -> list[BodyRow]:
    """Bodies of a frame before 4.1."""
    if not layout.body_markers:
        return r.rows(BODY, r.count(BODY.size, "rigid bodies"), "rigid bodies")
    rows: list[BodyRow] = []
    for _ in range(r.count(BODY_START.size + 8, "rigid bodies")):
        start = r.unpack(BODY_START, "a rigid body")
        r.skip(20, "markers of a body")
        rows.append((*start, *error_params(r, layout)))
    return rows
