"""Frames and model definitions as a server of any version sends them, 2.5 to 4.2."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import TypeVar

from vrbench_optitrack.frame import (
    Asset,
    Channels,
    Frame,
    LabeledMarker,
    MarkerSet,
    RigidBody,
    Skeleton,
    Suffix,
)
from vrbench_optitrack.layout import BODY, TAIL_25, TAIL_26, TAIL_27, TAIL_30, Layout, layout_of
from vrbench_optitrack.models import (
    AssetModel,
    BodyModel,
    CameraModel,
    DeviceModel,
    MarkerSetModel,
    Model,
    PlateModel,
    SkeletonModel,
    UnknownModel,
)
from vrbench_optitrack.wire import INT, PAIR, VECTOR, Message, Version, name_bytes, packed

_ASSET_MARKER = struct.Struct("<i3ffhf")
Item = TypeVar("Item")


def encode_frame(frame: Frame, version: Version) -> bytes:
    """The FRAMEOFDATA packet; what the version has no place for is left out."""
    layout = layout_of(version)
    parts = [
        INT.pack(frame.number),
        _section(frame.marker_sets, _marker_set, layout),
        _section(frame.other_markers, lambda p: VECTOR.pack(*p), layout),
        _section(frame.bodies, lambda body: _body(body, layout), layout),
        _section(frame.skeletons, lambda skeleton: _skeleton(skeleton, layout), layout),
    ]
    if layout.sized:
        parts.append(_section(frame.assets, _asset, layout))
    parts.append(_section(frame.labeled_markers, lambda m: _marker(m, layout), layout))
    if layout.plates:
        parts.append(_section(frame.force_plates, _channels, layout))
    if layout.devices:
        parts.append(_section(frame.devices, _channels, layout))
    parts.append(_suffix(frame.suffix, layout))
    return packed(Message.FRAME, b"".join(parts))


def _section(items: Sequence[Item], item: Callable[[Item], bytes], layout: Layout) -> bytes:
    body = b"".join(map(item, items))
    return (PAIR.pack(len(items), len(body)) if layout.sized else INT.pack(len(items))) + body


def _marker_set(markers: MarkerSet) -> bytes:
    positions = b"".join(VECTOR.pack(*p) for p in markers.positions)
    return name_bytes(markers.name) + INT.pack(len(markers.positions)) + positions


def _body(body: RigidBody, layout: Layout) -> bytes:
    if not layout.body_markers:
        return BODY.pack(body.id, *body.position, *body.orientation, body.mean_error, body.params)
    parts = [struct.pack("<i7fi", body.id, *body.position, *body.orientation, len(body.markers))]
    parts += [VECTOR.pack(*marker.position) for marker in body.markers]
    parts += [INT.pack(marker.id) for marker in body.markers]
    parts += [struct.pack("<f", marker.size) for marker in body.markers]
    parts.append(struct.pack("<f", body.mean_error))
    if layout.body_params:
        parts.append(struct.pack("<h", body.params))
    return b"".join(parts)


def _bodies(bodies: Sequence[RigidBody], layout: Layout) -> bytes:
    return INT.pack(len(bodies)) + b"".join(_body(body, layout) for body in bodies)


def _skeleton(skeleton: Skeleton, layout: Layout) -> bytes:
    return INT.pack(skeleton.id) + _bodies(skeleton.bodies, layout)


def _asset(asset: Asset) -> bytes:
    markers = b"".join(_ASSET_MARKER.pack(*_marker_row(m)) for m in asset.markers)
    bodies = _bodies(asset.bodies, layout_of((4, 1)))
    return INT.pack(asset.id) + bodies + INT.pack(len(asset.markers)) + markers


def _marker_row(marker: LabeledMarker) -> tuple[float, ...]:
    return marker.id, *marker.position, marker.size, marker.params, marker.residual


def _marker(marker: LabeledMarker, layout: Layout) -> bytes:
    row = _marker_row(marker)
    # id and three coordinates and a size; params from 2.6; the residual from 3.0
    kept = {20: 5, 22: 6, 26: 7}[layout.marker.size]
    return layout.marker.pack(*row[:kept])


def _channels(device: Channels) -> bytes:
    values = b"".join(
        struct.pack(f"<i{len(channel)}f", len(channel), *channel) for channel in device.channels
    )
    return PAIR.pack(device.id, len(device.channels)) + values


def _suffix(s: Suffix, layout: Layout) -> bytes:
    pack = layout.tail.layout.pack
    code = (s.timecode, s.timecode_sub)
    if layout.tail is TAIL_25:
        return pack(s.latency, *code, 0)
    if layout.tail in (TAIL_26, TAIL_27):
        return pack(s.latency, *code, s.timestamp, s.params, 0)
    ticks = (s.mid_exposure, s.data_received, s.transmit)
    if layout.tail is TAIL_30:
        return pack(*code, s.timestamp, *ticks, s.params, 0)
    return pack(*code, s.timestamp, *ticks, s.ptp_seconds, s.ptp_fraction, s.params, 0)


def encode_models(models: Sequence[Model], version: Version) -> bytes:
    """The MODELDEF packet."""
    sized = version >= (4, 1)
    parts = [INT.pack(len(models))]
    for model in models:
        kind, body = _model(model, version)
        parts.append((PAIR.pack(kind, len(body)) if sized else INT.pack(kind)) + body)
    return packed(Message.MODELDEF, b"".join(parts))


def _model(model: Model, version: Version) -> tuple[int, bytes]:
    """A description's type and bytes."""
    match model:
        case MarkerSetModel():
            return 0, name_bytes(model.name) + _texts(model.markers)
        case BodyModel():
            return 1, _body_model(model, version)
        case SkeletonModel():
            start = name_bytes(model.name) + PAIR.pack(model.id, len(model.bodies))
            return 2, start + b"".join(_body_model(body, version) for body in model.bodies)
        case PlateModel():
            return 3, _plate(model)
        case DeviceModel():
            start = INT.pack(model.id) + name_bytes(model.name) + name_bytes(model.serial)
            return 4, start + PAIR.pack(model.type, model.channel_type) + _texts(model.channels)
        case CameraModel():
            pose = struct.pack("<7f", *model.position, *model.orientation)
            return 5, name_bytes(model.name) + pose
        case AssetModel():
            return 6, _asset_model(model, version)
        case UnknownModel():
            return model.type, model.data


def _texts(texts: Sequence[str]) -> bytes:
    return INT.pack(len(texts)) + b"".join(map(name_bytes, texts))


def _body_model(body: BodyModel, version: Version) -> bytes:
    parts = [name_bytes(body.name), struct.pack("<ii3f", body.id, body.parent, *body.offset)]
    if version >= (4, 2):
        parts.append(struct.pack("<4f", *body.rotation))
    if version >= (3, 0):
        parts.append(INT.pack(len(body.markers)))
        parts += [VECTOR.pack(*p) for p in body.markers]
        parts += [INT.pack(label) for label in body.labels]
    if version >= (4, 0):
        parts += map(name_bytes, body.marker_names)
    return b"".join(parts)


def _plate(plate: PlateModel) -> bytes:
    numbers = (plate.width, plate.length, *plate.origin, *plate.calibration, *plate.corners)
    types = PAIR.pack(plate.type, plate.channel_type)
    start = INT.pack(plate.id) + name_bytes(plate.serial)
    return start + struct.pack("<161f", *numbers) + types + _texts(plate.channels)


def _asset_model(asset: AssetModel, version: Version) -> bytes:
    parts = [name_bytes(asset.name), PAIR.pack(asset.type, asset.id)]
    parts.append(INT.pack(len(asset.bodies)))
    parts += [_body_model(body, version) for body in asset.bodies]
    parts.append(INT.pack(len(asset.markers)))
    for marker in asset.markers:
        row = struct.pack("<i3ffh", marker.id, *marker.position, marker.size, marker.params)
        parts.append(name_bytes(marker.name) + row)
    return b"".join(parts)
