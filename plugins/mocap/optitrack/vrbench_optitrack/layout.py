"""What differs between versions of frames, and how a frame ends.

Bodies carry their markers before 3.0, and every section says its size from 4.1.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

from vrbench_optitrack.frame import UNSAID, Suffix
from vrbench_optitrack.wire import NEWEST, OLDEST, PAIR, NatNetError, Reader, Version, version_text

BODY = struct.Struct("<i3f4ffh")
BODY_START = struct.Struct("<i3f4f")
BODY_ERROR = struct.Struct("<f")
BODY_ERROR_PARAMS = struct.Struct("<fh")
ASSET_MARKER = struct.Struct("<i3ffhf")
LAST_BYTES = 6
"""Params and the end mark."""
FLOAT = struct.Struct("<f")


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


def strided(
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


def suffix_of(packet: bytes, at: int, layout: Layout) -> Suffix:
    """What ends a frame, from the byte behind its last section.

    Raises:
        NatNetError: more or less than that is left.
    """
    tail = layout.tail
    if len(packet) - at == tail.layout.size:
        return tail.suffix(*tail.layout.unpack_from(packet, at))
    found = _later_suffix(packet, at, tail) if layout.later else None
    if found is None:
        raise NatNetError(
            at,
            f"{len(packet) - at} bytes end the frame, in NatNet {version_text(layout.version)} "
            f"it is {tail.layout.size}",
        )
    return found


def _later_suffix(packet: bytes, at: int, tail: _Tail) -> Suffix | None:
    """The suffix of a version that isn't known, behind further sections or with further fields.

    None where it could be neither, or either: a wrong time would be worse than none.
    """
    size, end = tail.layout.size, len(packet)
    if end - at < size:
        return None
    found = []
    behind = at
    while behind < end - size:
        count, length = PAIR.unpack_from(packet, behind)
        if count < 0 or length < count or (length and not count):
            break
        behind += PAIR.size + length
    if behind == end - size:
        found.append(tail.suffix(*tail.layout.unpack_from(packet, behind)))
    # fields are added before the last two, as PTP's were
    longer = packet[at : at + size - LAST_BYTES] + packet[end - LAST_BYTES :]
    found.append(tail.suffix(*tail.layout.unpack(longer)))
    likely = [_likelihood(suffix) for suffix in found]
    best = max(likely)
    sure = best > 0 and likely.count(best) == 1 and packet[end - 4 :] == bytes(4)
    return found[likely.index(best)] if sure else None


def _likelihood(suffix: Suffix) -> int:
    """How many stamps it has that follow each other as they must; 0 where one doesn't."""
    ticks = [t for t in (suffix.mid_exposure, suffix.data_received, suffix.transmit) if t]
    nominal = suffix.timestamp
    ordered = ticks == sorted(ticks) and (nominal == 0.0 or 1e-4 < nominal < 1e9)
    return len(ticks) if ordered and 0 <= suffix.params < 0x100 else 0


def error_params(r: Reader, layout: Layout) -> tuple[float, int]:
    """A body's mean error, and its params or `UNSAID`."""
    if layout.body_params:
        error, params = r.unpack(BODY_ERROR_PARAMS, "a body's error")
        return error, params
    (error,) = r.unpack(BODY_ERROR, "a body's error")
    return error, UNSAID
