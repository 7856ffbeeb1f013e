"""What is known of PC headsets without asking the device.

Rates are those of their displays; the runtime gives poses at any rate that is asked for. Headsets
tracked by base stations have no cameras that could be covered.
"""

from __future__ import annotations

from collections.abc import Mapping

from vrbench.devices.specs import HeadsetProfile, HeadsetSpec, Tracking

NONE: Mapping[str, tuple[int, ...]] = {"none": ()}
FOUR = {0: "upper left", 1: "upper right", 2: "lower left", 3: "lower right"}
FOUR_LEVELS = {"none": (), "two": (0, 3), "three": (0, 2, 3)}
TWO = {0: "left", 1: "right"}
TWO_LEVELS = {"none": (), "one": (0,)}
TRACKING = Tracking(source="made up; no recordings at hand")


def _spec(
    name: str,
    title: str,
    rate_hz: float,
    cameras: Mapping[int, str],
    occlusion: Mapping[str, tuple[int, ...]],
) -> HeadsetSpec:
    profile = HeadsetProfile(
        rate_hz=rate_hz,
        cameras=cameras,
        clock="monotonic",
        occlusion=occlusion,
        tracking=TRACKING,
    )
    return HeadsetSpec(name=name, title=title, profile=profile)


HEADSETS = (
    _spec("index", "Valve Index (base stations)", 144.0, {}, NONE),
    _spec("vive", "HTC Vive, Vive Pro (base stations)", 90.0, {}, NONE),
    _spec("varjo", "Varjo XR-3, XR-4 (their own cameras)", 90.0, TWO, TWO_LEVELS),
    _spec("wmr", "Windows Mixed Reality", 90.0, TWO, TWO_LEVELS),
    _spec("psvr2", "PlayStation VR2 with the PC adapter", 120.0, FOUR, FOUR_LEVELS),
    _spec("monado", "Any headset of Monado", 90.0, {}, NONE),
)
