"""Throws damaged and made-up packets at every decoder; anything but NatNetError is a failure.

python benchmarks/fuzz.py [INPUTS] [SEED]
"""

from __future__ import annotations

import random
import struct
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from typing import Any

from decode import frame
from vrbench_optitrack.bodies import decode_bodies
from vrbench_optitrack.encode import encode_frame, encode_models
from vrbench_optitrack.frames import decode_frame
from vrbench_optitrack.handshake import (
    ServerInfo,
    decode_echo_response,
    decode_greeting,
    decode_number,
    decode_serverinfo,
    encode_serverinfo,
)
from vrbench_optitrack.models import BodyModel, CameraModel, MarkerSetModel, decode_models
from vrbench_optitrack.wire import NatNetError

VERSIONS = [(2, 5), (2, 6), (2, 7), (2, 9), (3, 0), (4, 0), (4, 1), (4, 2), (4, 3)]
LIMIT_S, LIMIT_BYTES = 0.2, 4_000_000
NASTY = [b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff", b"\0\0\0\x80", b"\x00\x00\x01\x00", b"\0" * 4]


def seeds() -> list[bytes]:
    body = BodyModel(
        "b", 1, -1, (0.0,) * 3, markers=((0.0,) * 3,), labels=(0,), marker_names=("m",)
    )
    models = [body, MarkerSetModel("s", ("a", "b")), CameraModel("c", (0.0,) * 3, (0.0,) * 4)]
    packets = [
        encode_serverinfo(ServerInfo("Motive", (3,) * 4, (4, 1, 0, 0), 10**7, 1511, True, ""))
    ]
    for version in VERSIONS:
        packets += [encode_frame(frame(2, 6), version), encode_models(models, version)]
    return packets


def inputs(rng: random.Random) -> Iterator[bytes]:
    """Bytes without end: a quarter made up, the rest good packets that were damaged."""
    good = seeds()
    while True:
        if rng.random() < 0.25:
            body = rng.randbytes(rng.randrange(0, 300))
            yield struct.pack("<HH", rng.choice((1, 3, 5, 7, 13)), len(body)) + body
            continue
        packet = bytearray(rng.choice(good))
        for _ in range(rng.randint(1, 4)):
            at = rng.randrange(4, len(packet))
            match rng.randrange(4):
                case 0:
                    packet[at] = rng.randrange(256)
                case 1:
                    packet[at : at + 4] = rng.choice(NASTY)
                case 2:
                    del packet[at : at + rng.randint(1, 20)]
                case _:
                    packet[at:at] = rng.randbytes(rng.randint(1, 8))
            if len(packet) < 6:
                break
        if rng.random() < 0.9:
            packet[2:4] = struct.pack("<H", len(packet) - 4)
        yield bytes(packet)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    rng = random.Random(int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    plain: list[Callable[[bytes], Any]] = [
        decode_serverinfo,
        decode_greeting,
        decode_echo_response,
        decode_number,
    ]
    refused = read = 0
    slowest = 0.0
    began = time.perf_counter()
    tracemalloc.start()
    source = inputs(rng)
    for n in range(count):
        packet, version = next(source), rng.choice(VERSIONS)
        calls: list[Callable[[], Any]] = [
            lambda p=packet, v=version: decode_frame(p, v),
            lambda p=packet, v=version: decode_bodies(p, v),
            lambda p=packet, v=version: decode_models(p, v),
            *(lambda p=packet, d=d: d(p) for d in plain),
        ]
        start = time.perf_counter()
        for call in calls:
            try:
                call()
                read += 1
            except NatNetError:
                refused += 1
        slowest = max(slowest, time.perf_counter() - start)
        if n % 1000 == 0:
            peak = tracemalloc.get_traced_memory()[1]
            if peak > LIMIT_BYTES:
                raise SystemExit(f"input {n}: {peak} bytes were allocated: {packet!r}")
    peak = tracemalloc.get_traced_memory()[1]
    print(
        f"{count} inputs, {read + refused} decodings in {time.perf_counter() - began:.0f} s: "
        f"{refused} refused, {read} read, no other error; slowest input {slowest * 1e3:.1f} ms, "
        f"peak memory {peak / 1e6:.2f} MB"
    )


if __name__ == "__main__":
    main()
