"""FRAMEOFDATA: all of a frame, field by field, or its rigid bodies and times alone, quickly.

Layouts differ by version: bodies carry their markers before 3.0, every section says its size from
4.1. A frame that doesn't end exactly where its last field ends is refused: read in a wrong version
it would give poses that look right.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, TypeVar

from vrbench_optitrack.wire import (
    HEADER,
    INT,
    NEWEST,
    OLDEST,
    PAIR,
    VECTOR,
    Message,
    NatNetError,
    Reader,
    Version,
    reader_of,
    version_text,
)

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
BodyRow = tuple[int, float, float, float, float, float, float, float, float, int]
"""A rigid body as `id, x, y, z, qx, qy, qz, qw, mean error, params`."""

VALID = 0x01
UNSAID = -1
"""`params` of a body where the version has none (2.5): whether it is tracked isn't said."""
RECORDING, MODELS_CHANGED, EDIT_MODE, BITSTREAM_CHANGED = 0x01, 0x02, 0x04, 0x08

BODY = struct.Struct("<i3f4ffh")
_BODY_START = struct.Struct("<i3f4f")
_BODY_ERROR = struct.Struct("<f")
_BODY_ERROR_PARAMS = struct.Struct("<fh")
_SIZED = struct.Struct("<i3f4ffh")
_ASSET_MARKER = struct.Struct("<i3ffhf")
_FLOATS = struct.Struct("<f")


class MarkerSet(NamedTuple):
    """Markers under a name [server's unit]."""

    name: str
    positions: list[Vector]


class BodyMarker(NamedTuple):
    """A marker that a rigid body carries, before NatNet 3."""

    position: Vector
    id: int
    size: float


class RigidBody(NamedTuple):
    """A rigid body.

    Attributes:
        id: streaming id.
        position: of its pivot [server's unit].
        orientation: xyzw.
        mean_error: of its markers [m].
        params: bit 0: tracked; `UNSAID` where the version doesn't say.
        markers: before NatNet 3.
    """

    id: int
    position: Vector
    orientation: Quaternion
    mean_error: float
    params: int
    markers: tuple[BodyMarker, ...] = ()


class Skeleton(NamedTuple):
    """A skeleton: its bones."""

    id: int
    bodies: list[RigidBody]


class LabeledMarker(NamedTuple):
    """A marker with an id: the model's in the upper half, its own in the lower."""

    id: int
    position: Vector
    size: float
    params: int
    residual: float

    @property
    def model_id(self) -> int:
        return self.id >> 16 & 0xFFFF

    @property
    def marker_id(self) -> int:
        return self.id & 0xFFFF


class Asset(NamedTuple):
    """A trained markerset: its bodies and markers."""

    id: int
    bodies: list[RigidBody]
    markers: list[LabeledMarker]


class Channels(NamedTuple):
    """A force plate or device: values of each channel."""

    id: int
    channels: list[tuple[float, ...]]


class Suffix(NamedTuple):
    """What ends a frame.

    Attributes:
        timecode: SMPTE, as sent.
        timecode_sub: the same.
        timestamp: nominal time of the frame [s]; no clock.
        latency: 2.x: the software's time [s].
        mid_exposure: middle of the cameras' exposure [ticks]; 0 where not known.
        data_received: when the cameras' data came in [ticks].
        transmit: when the frame left [ticks].
        ptp_seconds: PTP time, from 4.1 [s].
        ptp_fraction: its fraction, as sent.
        params: recording, models changed, edit mode, bitstream changed.
    """

    timecode: int
    timecode_sub: int
    timestamp: float
    latency: float
    mid_exposure: int
    data_received: int
    transmit: int
    ptp_seconds: int
    ptp_fraction: int
    params: int


class BodyFrame(NamedTuple):
    """A frame's rigid bodies and times."""

    number: int
    bodies: list[BodyRow]
    suffix: Suffix


@dataclass(frozen=True, slots=True)
class Frame:
    """All of a frame."""

    number: int
    marker_sets: list[MarkerSet]
    other_markers: list[Vector]
    bodies: list[RigidBody]
    skeletons: list[Skeleton]
    assets: list[Asset]
    labeled_markers: list[LabeledMarker]
    force_plates: list[Channels]
    devices: list[Channels]
    suffix: Suffix


class _Tail(NamedTuple):
    """How a version ends its frames: the struct, and the suffix of its values."""

    layout: struct.Struct
    suffix: Callable[..., Suffix]


def _tail_25(latency: float, code: int, sub: int, _eod: int) -> Suffix:
    return Suffix(code, sub, 0.0, latency, 0, 0, 0, 0, 0, 0)


def _tail_26(latency: float, code: int, sub: int, stamp: float, params: int, _eod: int) -> Suffix:
    return Suffix(code, sub, stamp, latency, 0, 0, 0, 0, 0, params)


def _tail_30(
    code: int, sub: int, stamp: float, mid: int, data: int, sent: int, params: int, _eod: int
) -> Suffix:
    return Suffix(code, sub, stamp, 0.0, mid, data, sent, 0, 0, params)


def _tail_41(
    code: int,
    sub: int,
    stamp: float,
    mid: int,
    data: int,
    sent: int,
    ptp: int,
    fraction: int,
    params: int,
    _eod: int,
) -> Suffix:
    return Suffix(code, sub, stamp, 0.0, mid, data, sent, ptp, fraction, params)


TAIL_25 = _Tail(struct.Struct("<fIIi"), _tail_25)
TAIL_26 = _Tail(struct.Struct("<fIIfhi"), _tail_26)
TAIL_27 = _Tail(struct.Struct("<fIIdhi"), _tail_26)
TAIL_30 = _Tail(struct.Struct("<IIdQQQhi"), _tail_30)
TAIL_41 = _Tail(struct.Struct("<IIdQQQIIhi"), _tail_41)


@dataclass(frozen=True, slots=True)
class Layout:
    """What differs between versions.

    Attributes:
        version: the version.
        sized: every section says its size (4.1).
        later: a version past those that are known: items may be longer than we read.
        body_markers: bodies carry their markers (before 3.0).
        body_params: bodies say whether they are tracked (2.6).
        marker: a labeled marker.
        plates: there are force plates (2.9).
        devices: there are devices (3.0).
        tail: the suffix.
    """

    version: Version
    sized: bool
    later: bool
    body_markers: bool
    body_params: bool
    marker: struct.Struct
    plates: bool
    devices: bool
    tail: _Tail


@cache
def layout_of(version: Version) -> Layout:
    """The layout of a version.

    Raises:
        NatNetError: older than 2.5.
    """
    if version < OLDEST:
        raise NatNetError(0, f"NatNet {version_text(version)} is older than 2.5")
    if version >= (4, 1):
        tail = TAIL_41
    elif version >= (3, 0):
        tail = TAIL_30
    elif version >= (2, 7):
        tail = TAIL_27
    else:
        tail = TAIL_26 if version >= (2, 6) else TAIL_25
    if version >= (3, 0):
        marker = struct.Struct("<i3ffhf")
    else:
        marker = struct.Struct("<i3ffh" if version >= (2, 6) else "<i3ff")
    return Layout(
        version=version,
        sized=version >= (4, 1),
        later=version > NEWEST,
        body_markers=version < (3, 0),
        body_params=version >= (2, 6),
        marker=marker,
        plates=version >= (2, 9),
        devices=version >= (3, 0),
        tail=tail,
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
                bodies = _strided(packet, start, count, size, BODY, layout)
    return BodyFrame(INT.unpack_from(packet, 4)[0], bodies, _suffix(packet, at, layout))


def _strided(
    packet: bytes, at: int, count: int, size: int, item: struct.Struct, layout: Layout
) -> list[tuple[Any, ...]]:
    """Items of one size, of which a later version may have made more than we know."""
    stride, rest = divmod(size, count)
    if rest or stride < item.size or (stride > item.size and not layout.later):
        raise NatNetError(
            at - 4,
            f"{count} items in {size} bytes: {item.size} each in NatNet "
            f"{version_text(layout.version)}",
        )
    return [item.unpack_from(packet, at + i * stride) for i in range(count)]


def _suffix(packet: bytes, at: int, layout: Layout) -> Suffix:
    tail = layout.tail
    if len(packet) - at != tail.layout.size:
        raise NatNetError(
            at,
            f"{len(packet) - at} bytes end the frame, in NatNet {version_text(layout.version)} "
            f"it is {tail.layout.size}",
        )
    return tail.suffix(*tail.layout.unpack_from(packet, at))


def _bodies_hurried(packet: bytes, layout: Layout) -> BodyFrame | None:
    """As `_bodies_walked`, at half its time; None where anything is amiss: that says what."""
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
                head = _BODY_START.unpack_from(packet, at)
                at += 36 + 20 * n
                if layout.body_params:
                    rows.append(head + _BODY_ERROR_PARAMS.unpack_from(packet, at))
                    at += 6
                else:
                    rows.append((*head, *_BODY_ERROR.unpack_from(packet, at), UNSAID))
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
    return BodyFrame(number, bodies, _suffix(packet, r.at, layout))


def _body_rows(r: Reader, layout: Layout) -> list[BodyRow]:
    """Bodies of a frame before 4.1."""
    if not layout.body_markers:
        return r.rows(BODY, r.count(BODY.size, "rigid bodies"), "rigid bodies")
    rows: list[BodyRow] = []
    for _ in range(r.count(_BODY_START.size + 8, "rigid bodies")):
        start = r.unpack(_BODY_START, "a rigid body")
        r.skip(20, "markers of a body")
        rows.append((*start, *_error_params(r, layout)))
    return rows


def _error_params(r: Reader, layout: Layout) -> tuple[float, int]:
    if layout.body_params:
        error, params = r.unpack(_BODY_ERROR_PARAMS, "a body's error")
        return error, params
    (error,) = r.unpack(_BODY_ERROR, "a body's error")
    return error, UNSAID


def decode_frame(packet: bytes, version: Version) -> Frame:
    """All of a frame.

    Raises:
        NatNetError: no frame of this version, to the byte.
    """
    layout = layout_of(version)
    r = reader_of(packet, Message.FRAME)
    number = r.integer("the frame's number")
    marker_sets = _section(r, layout, 5, "marker sets", _marker_set)
    others = _fixed_section(r, layout, VECTOR, "other markers")
    if layout.body_markers:
        bodies = _section(r, layout, 40, "rigid bodies", _marked_body)
    else:
        bodies = [_body(row) for row in _fixed_section(r, layout, BODY, "rigid bodies")]
    skeletons = _section(r, layout, 8, "skeletons", _skeleton)
    assets = _section(r, layout, 12, "assets", _asset) if layout.sized else []
    labeled = _fixed_section(r, layout, layout.marker, "labeled markers")
    plates = _section(r, layout, 8, "force plates", _channels) if layout.plates else []
    devices = _section(r, layout, 8, "devices", _channels) if layout.devices else []
    return Frame(
        number=number,
        marker_sets=marker_sets,
        other_markers=others,
        bodies=bodies,
        skeletons=skeletons,
        assets=assets,
        labeled_markers=[_marker(row) for row in labeled],
        force_plates=plates,
        devices=devices,
        suffix=_suffix(packet, r.at, layout),
    )


Item = TypeVar("Item")


def _section(
    r: Reader, layout: Layout, least: int, what: str, item: Callable[[Reader, Layout], Item]
) -> list[Item]:
    """A section of items, each read by `item`; where it says its size, it must fill it."""
    if not layout.sized:
        return [item(r, layout) for _ in range(r.count(least, what))]
    count, end = _sized(r, what)
    inner = Reader(r.data, r.at, end)
    if count * least > inner.left:
        raise NatNetError(r.at - 8, f"{count} {what} can't be in {inner.left} bytes")
    items = [item(inner, layout) for _ in range(count)]
    inner.finish(what)
    r.at = end
    return items


def _fixed_section(
    r: Reader, layout: Layout, item: struct.Struct, what: str
) -> list[tuple[Any, ...]]:
    """A section of items of one size."""
    if not layout.sized:
        return r.rows(item, r.count(item.size, what), what)
    count, end = _sized(r, what)
    start, r.at = r.at, end
    if not count and start != end:
        raise NatNetError(start, f"{end - start} bytes for no {what}")
    return _strided(r.data, start, count, end - start, item, layout) if count else []


def _sized(r: Reader, what: str) -> tuple[int, int]:
    """How many items a section has, and where it ends."""
    start = r.at
    count, size = r.unpack(PAIR, f"the number and size of {what}")
    if count < 0 or size < 0 or size > r.left or count > size:
        raise NatNetError(start, f"{count} {what} in {size} bytes, {r.left} are left")
    return count, r.at + size


def _marker_set(r: Reader, _layout: Layout) -> MarkerSet:
    name = r.text("a marker set's name")
    rows = r.rows(VECTOR, r.count(12, "markers of a set"), "markers of a set")
    return MarkerSet(name, rows)


def _body(row: tuple[Any, ...]) -> RigidBody:
    return RigidBody(row[0], row[1:4], row[4:8], row[8], row[9])


def _marked_body(r: Reader, layout: Layout) -> RigidBody:
    """A body before NatNet 3: it carries its markers."""
    start = r.unpack(_BODY_START, "a rigid body")
    n = r.count(20, "markers of a body")
    positions = r.rows(VECTOR, n, "markers of a body")
    ids = r.rows(INT, n, "ids of a body's markers")
    sizes = r.rows(_FLOATS, n, "sizes of a body's markers")
    markers = tuple(
        BodyMarker(position, id_, size)
        for position, (id_,), (size,) in zip(positions, ids, sizes, strict=True)
    )
    error, params = _error_params(r, layout)
    return RigidBody(start[0], start[1:4], start[4:8], error, params, markers)


def _skeleton(r: Reader, layout: Layout) -> Skeleton:
    id_ = r.integer("a skeleton's id")
    if layout.body_markers:
        n = r.count(40, "bones")
        return Skeleton(id_, [_marked_body(r, layout) for _ in range(n)])
    return Skeleton(id_, _plain_bodies(r, "bones"))


def _plain_bodies(r: Reader, what: str) -> list[RigidBody]:
    return [_body(row) for row in r.rows(BODY, r.count(BODY.size, what), what)]


def _asset(r: Reader, _layout: Layout) -> Asset:
    id_ = r.integer("an asset's id")
    bodies = _plain_bodies(r, "bodies of an asset")
    n = r.count(_ASSET_MARKER.size, "markers of an asset")
    rows = r.rows(_ASSET_MARKER, n, "markers of an asset")
    return Asset(id_, bodies, [_marker(row) for row in rows])


def _marker(row: tuple[Any, ...]) -> LabeledMarker:
    params = row[5] if len(row) > 5 else 0
    residual = row[6] if len(row) > 6 else 0.0
    return LabeledMarker(row[0], row[1:4], row[4], params, residual)


def _channels(r: Reader, _layout: Layout) -> Channels:
    id_ = r.integer("a device's id")
    channels = []
    for _ in range(r.count(4, "channels")):
        rows = r.rows(_FLOATS, r.count(4, "values of a channel"), "values of a channel")
        channels.append(tuple(value for (value,) in rows))
    return Channels(id_, channels)
