"""MODELDEF: what the streaming ids of frames are called, and where their markers sit."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

from vrbench_optitrack.frame import Quaternion, Vector
from vrbench_optitrack.wire import (
    INT,
    NEWEST,
    VECTOR,
    Message,
    NatNetError,
    Reader,
    Version,
    reader_of,
)

_QUATERNION = struct.Struct("<4f")
_PLATE = struct.Struct("<2f3f144f12fii")
_PAIR = struct.Struct("<ii")
_ASSET_MARKER = struct.Struct("<i3ffh")
EXACT_TO: Version = (4, 1)
"""Up to here the layouts of plates, devices, cameras and assets are known from a public sample."""


@dataclass(frozen=True, slots=True)
class MarkerSetModel:
    """A marker set: its markers' names."""

    name: str
    markers: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class BodyModel:
    """A rigid body.

    Attributes:
        name: as Motive shows it.
        id: streaming id, which frames carry.
        parent: id of the parent; -1 without one.
        offset: from the parent [server's unit].
        rotation: from the parent, xyzw; from 4.2.
        markers: of the markers, from the pivot [server's unit]; from 3.0.
        labels: required active labels; from 3.0.
        marker_names: from 4.0.
    """

    name: str
    id: int
    parent: int
    offset: Vector
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    markers: tuple[Vector, ...] = ()
    labels: tuple[int, ...] = ()
    marker_names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class SkeletonModel:
    """A skeleton: its bones."""

    name: str
    id: int
    bodies: tuple[BodyModel, ...]


@dataclass(frozen=True, slots=True)
class PlateModel:
    """A force plate."""

    id: int
    serial: str
    width: float
    length: float
    origin: Vector
    calibration: tuple[float, ...]
    corners: tuple[float, ...]
    type: int
    channel_type: int
    channels: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class DeviceModel:
    """A device with channels."""

    id: int
    name: str
    serial: str
    type: int
    channel_type: int
    channels: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class CameraModel:
    """A camera, and where it stands [server's unit]."""

    name: str
    position: Vector
    orientation: Quaternion


@dataclass(frozen=True, slots=True)
class AssetMarkerModel:
    """A marker of an asset."""

    name: str
    id: int
    position: Vector
    size: float
    params: int


@dataclass(frozen=True, slots=True)
class AssetModel:
    """A trained marker set."""

    name: str
    type: int
    id: int
    bodies: tuple[BodyModel, ...]
    markers: tuple[AssetMarkerModel, ...]


@dataclass(frozen=True, slots=True)
class UnknownModel:
    """A description of a kind or layout that isn't known here, as its bytes."""

    type: int
    data: bytes


Model = (
    MarkerSetModel
    | BodyModel
    | SkeletonModel
    | PlateModel
    | DeviceModel
    | CameraModel
    | AssetModel
    | UnknownModel
)


def decode_models(packet: bytes, version: Version) -> list[Model]:
    """All descriptions of a MODELDEF.

    From 4.1 each says its size, and a kind that isn't known is kept as bytes; so is, past 4.1, a
    description other than of marker sets, bodies and skeletons whose layout has changed. What a
    version past those that are known has added to a description is left out.

    Raises:
        NatNetError: no MODELDEF of this version, to the byte.
    """
    r = reader_of(packet, Message.MODELDEF)
    sized = version >= (4, 1)
    models: list[Model] = []
    for _ in range(r.count(8 if sized else 4, "descriptions")):
        start = r.at
        kind = r.integer("a description's type")
        if not sized:
            if kind not in _KINDS:
                raise NatNetError(start, f"description type {kind} isn't known")
            models.append(_KINDS[kind](r, version))
            continue
        size = r.count(1, "bytes of a description")
        inner = Reader(r.data, r.at, r.at + size)
        models.append(_described(inner, kind, version))
        r.at = inner.end
    r.finish("the descriptions")
    return models


def bodies_of(models: list[Model]) -> list[BodyModel]:
    """The rigid bodies among descriptions; bones of skeletons are none."""
    return [model for model in models if isinstance(model, BodyModel)]


def _described(r: Reader, kind: int, version: Version) -> Model:
    """One description that fills its own size."""
    start = r.at
    unknown = UnknownModel(kind, r.data[start : r.end])
    if kind not in _KINDS:
        return unknown
    try:
        model = _KINDS[kind](r, version)
        if version <= NEWEST:
            r.finish("a description")
    except NatNetError:
        if version > NEWEST:
            again = Reader(r.data, start, r.end)
            return _named(again, unknown) if kind == 1 else unknown
        if kind > 2 and version > EXACT_TO:
            return unknown
        raise
    return model


def _named(r: Reader, unknown: UnknownModel) -> Model:
    """A body of which only what comes first can be read: that is enough to follow it."""
    try:
        name = r.text("a body's name")
        id_, parent = r.unpack(_PAIR, "a body's ids")
        return BodyModel(name, id_, parent, r.unpack(VECTOR, "a body's offset"))
    except NatNetError:
        return unknown


def _marker_set(r: Reader, _version: Version) -> MarkerSetModel:
    name = r.text("a marker set's name")
    return MarkerSetModel(name, _texts(r, "names of markers"))


def _texts(r: Reader, what: str) -> tuple[str, ...]:
    return tuple(r.text(what) for _ in range(r.count(1, what)))


def _body(r: Reader, version: Version) -> BodyModel:
    name = r.text("a body's name")
    id_, parent = r.unpack(_PAIR, "a body's ids")
    offset = r.unpack(VECTOR, "a body's offset")
    rotation = (0.0, 0.0, 0.0, 1.0)
    if version >= (4, 2):
        rotation = r.unpack(_QUATERNION, "a body's rotation")
    if version < (3, 0):
        return BodyModel(name, id_, parent, offset, rotation)
    n = r.count(17 if version >= (4, 0) else 16, "markers of a body")
    markers = r.rows(VECTOR, n, "markers of a body")
    labels = r.rows(INT, n, "labels of a body's markers")
    names = tuple(r.text("a marker's name") for _ in range(n)) if version >= (4, 0) else ()
    return BodyModel(
        name,
        id_,
        parent,
        offset,
        rotation,
        tuple(markers),
        tuple(label for (label,) in labels),
        names,
    )


def _skeleton(r: Reader, version: Version) -> SkeletonModel:
    name = r.text("a skeleton's name")
    id_ = r.integer("a skeleton's id")
    n = r.count(21, "bones")
    return SkeletonModel(name, id_, tuple(_body(r, version) for _ in range(n)))


def _plate(r: Reader, _version: Version) -> PlateModel:
    id_ = r.integer("a plate's id")
    serial = r.text("a plate's serial number")
    values = r.unpack(_PLATE, "a plate")
    return PlateModel(
        id=id_,
        serial=serial,
        width=values[0],
        length=values[1],
        origin=values[2:5],
        calibration=values[5:149],
        corners=values[149:161],
        type=values[161],
        channel_type=values[162],
        channels=_texts(r, "channels"),
    )


def _device(r: Reader, _version: Version) -> DeviceModel:
    id_ = r.integer("a device's id")
    name, serial = r.text("a device's name"), r.text("a device's serial number")
    type_, channel_type = r.unpack(_PAIR, "a device's types")
    return DeviceModel(id_, name, serial, type_, channel_type, _texts(r, "channels"))


def _camera(r: Reader, _version: Version) -> CameraModel:
    name = r.text("a camera's name")
    position = r.unpack(VECTOR, "a camera's position")
    return CameraModel(name, position, r.unpack(_QUATERNION, "a camera's orientation"))


def _asset(r: Reader, version: Version) -> AssetModel:
    name = r.text("an asset's name")
    type_, id_ = r.unpack(_PAIR, "an asset's ids")
    bodies = tuple(_body(r, version) for _ in range(r.count(21, "bodies of an asset")))
    markers = []
    for _ in range(r.count(_ASSET_MARKER.size + 1, "markers of an asset")):
        label = r.text("a marker's name")
        row = r.unpack(_ASSET_MARKER, "a marker of an asset")
        markers.append(AssetMarkerModel(label, row[0], row[1:4], *row[4:]))
    return AssetModel(name, type_, id_, bodies, tuple(markers))


_KINDS: dict[int, Callable[[Reader, Version], Model]] = {
    0: _marker_set,
    1: _body,
    2: _skeleton,
    3: _plate,
    4: _device,
    5: _camera,
    6: _asset,
}
