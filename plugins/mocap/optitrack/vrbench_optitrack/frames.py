"""FRAMEOFDATA: all of a frame, field by field.

A frame that doesn't end exactly where its last field ends is refused: read in a wrong version it
would give poses that look right.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, TypeVar

from vrbench_optitrack.frame import (
    Asset,
    BodyMarker,
    Channels,
    Frame,
    LabeledMarker,
    MarkerSet,
    RigidBody,
    Skeleton,
)
from vrbench_optitrack.layout import (
    ASSET_MARKER,
    BODY,
    BODY_START,
    FLOAT,
    Layout,
    error_params,
    layout_of,
    strided,
    suffix_of,
)
from vrbench_optitrack.wire import (
    INT,
    PAIR,
    VECTOR,
    Message,
    NatNetError,
    Reader,
    Version,
    reader_of,
)


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
        suffix=suffix_of(packet, r.at, layout),
    )


Item = TypeVar("Item")


def _section(
    r: Reader, layout: Layout, least: int, what: str, item: Callable[[Reader, Layout], Item]
) -> list[Item]:
    """A section of items, each read by `item`; where it says its size, they must fill it.

    Items of a later version that don't are left out.
    """
    if not layout.sized:
        return [item(r, layout) for _ in range(r.count(least, what))]
    count, end = _sized(r, what)
    inner = Reader(r.data, r.at, end)
    if count * least > inner.left:
        raise NatNetError(r.at - 8, f"{count} {what} can't be in {inner.left} bytes")
    r.at = end
    try:
        items = [item(inner, layout) for _ in range(count)]
        inner.finish(what)
    except NatNetError:
        if layout.later:
            return []  # its items have grown inside, where nothing says how
        raise
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
    return strided(r.data, start, count, end - start, item, layout) if count else []


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
    start = r.unpack(BODY_START, "a rigid body")
    n = r.count(20, "markers of a body")
    positions = r.rows(VECTOR, n, "markers of a body")
    ids = r.rows(INT, n, "ids of a body's markers")
    sizes = r.rows(FLOAT, n, "sizes of a body's markers")
    markers = tuple(
        BodyMarker(position, id_, size)
        for position, (id_,), (size,) in zip(positions, ids, sizes, strict=True)
    )
    error, params = error_params(r, layout)
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
    n = r.count(ASSET_MARKER.size, "markers of an asset")
    rows = r.rows(ASSET_MARKER, n, "markers of an asset")
    return Asset(id_, bodies, [_marker(row) for row in rows])


def _marker(row: tuple[Any, ...]) -> LabeledMarker:
    params = row[5] if len(row) > 5 else 0
    residual = row[6] if len(row) > 6 else 0.0
    return LabeledMarker(row[0], row[1:4], row[4], params, residual)


def _channels(r: Reader, _layout: Layout) -> Channels:
    id_ = r.integer("a device's id")
    channels = []
    for _ in range(r.count(4, "channels")):
        rows = r.rows(FLOAT, r.count(4, "values of a channel"), "values of a channel")
        channels.append(tuple(value for (value,) in rows))
    return Channels(id_, channels)
