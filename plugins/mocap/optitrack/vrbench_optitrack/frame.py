"""What a frame holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
BodyRow = tuple[int, float, float, float, float, float, float, float, float, int]
"""A rigid body as `id, x, y, z, qx, qy, qz, qw, mean error, params`."""

VALID = 0x01
UNSAID = -1
"""`params` of a body where the version has none (2.5): whether it is tracked isn't said."""
RECORDING, MODELS_CHANGED, EDIT_MODE, BITSTREAM_CHANGED = 0x01, 0x02, 0x04, 0x08


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
