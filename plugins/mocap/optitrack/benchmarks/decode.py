"""Time to decode a frame of 10 bodies and 100 markers, by version: bodies alone, and all of it."""

from __future__ import annotations

import sys
import timeit
from functools import partial

from vrbench_optitrack.bodies import decode_bodies
from vrbench_optitrack.encode import encode_frame
from vrbench_optitrack.frame import BodyMarker, Frame, LabeledMarker, MarkerSet, RigidBody, Suffix
from vrbench_optitrack.frames import decode_frame

VERSIONS = [(2, 9), (3, 1), (4, 0), (4, 1), (4, 2)]


def frame(bodies: int, markers: int) -> Frame:
    """A frame as Motive sends it: each body's markers in sets, and all of them labeled."""
    place = (0.1, 1.2, -0.3)
    carried = tuple(BodyMarker(place, i, 0.014) for i in range(4))
    return Frame(
        number=1,
        marker_sets=[MarkerSet(f"body {i}", [place] * 4) for i in range(bodies)]
        + [MarkerSet("all", [place] * 4 * bodies)],
        other_markers=[place] * max(0, markers - 4 * bodies),
        bodies=[
            RigidBody(i, place, (0.0, 0.0, 0.0, 1.0), 0.0002, 1, carried) for i in range(bodies)
        ],
        skeletons=[],
        assets=[],
        labeled_markers=[LabeledMarker(i, place, 0.014, 10, 0.0002) for i in range(markers)],
        force_plates=[],
        devices=[],
        suffix=Suffix(0, 0, 1.5, 0.0, 1, 2, 3, 4, 5, 0),
    )


def main() -> None:
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    print("NatNet  bytes  bodies alone [us]  whole frame [us]   (best of 5)")
    for version in VERSIONS:
        packet = encode_frame(frame(10, 100), version)
        times = [
            min(timeit.repeat(partial(decode, packet, version), number=n, repeat=5)) / n * 1e6
            for decode, n in ((decode_bodies, rounds), (decode_frame, rounds // 10))
        ]
        print(f"{version[0]}.{version[1]:<5} {len(packet):6} {times[0]:18.1f} {times[1]:17.1f}")


if __name__ == "__main__":
    main()
