"""Conformance of headsets and of motion capture: what only one of them has."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vrbench.devices.rehearsal import RECENTRE_EVERY_S
from vrbench.devices.specs import HeadsetProfile
from vrbench.plugin.testing.offered import WithStandIn
from vrbench.plugin.testing.sources import SourceConformance, clear_of
from vrbench.plugin.testing.verdicts import NotCheckedError, require

CLOCKS = ("utc", "monotonic", "device")


class HeadsetModelConformance(WithStandIn):
    """What a headset model is held to, that is known by its profile alone."""

    kind = "headset"

    def test_profile_is_sound(self) -> None:
        """Rate, clock, cameras and occlusion levels of the model make sense."""
        spec = self.thing()
        profile: HeadsetProfile | None = spec.profile
        if profile is None:
            raise NotCheckedError(f"{self.name} is a route", "models have profiles")
        require(10.0 <= profile.rate_hz <= 2000.0, f"rate_hz is {profile.rate_hz}", "In hertz.")
        require(
            profile.clock in CLOCKS, f"clock is {profile.clock!r}", f"One of {', '.join(CLOCKS)}."
        )
        for level, ids in profile.occlusion.items():
            unknown = sorted(set(ids) - set(profile.cameras))
            require(
                not unknown and len(set(ids)) == len(ids),
                f"level {level!r} covers cameras {list(ids)}, there are {sorted(profile.cameras)}",
                "Name cameras by their ids in `cameras`, each once.",
            )


class HeadsetConformance(SourceConformance, HeadsetModelConformance):
    """What a headset, or a route to headsets, is held to."""

    kind = "headset"
    stream = "headset/eye"

    def test_recentre_begins_an_epoch(self) -> None:
        """A recentre begins a new epoch, and nothing else does."""
        s, samples = self.timed(), self.came().samples
        shown = np.floor(s / RECENTRE_EVERY_S).astype(np.int64)
        keep = clear_of(s, recentred=True)
        pairs = sorted(set(zip(shown[keep].tolist(), samples.epoch[keep].tolist(), strict=True)))
        require(
            len({a for a, _ in pairs}) == len(pairs) == len({b for _, b in pairs}),
            f"{len(set(shown[keep].tolist()))} worlds were shown, and epochs "
            f"{_few(samples.epoch[keep])} came",
            "Count `epoch` up by one when the runtime tells of a recentre, and at no other time.",
        )
        require(
            np.all(np.diff(samples.epoch.astype(np.int64)) >= 0),
            "epochs go back",
            "Never use an epoch's number again.",
        )


class MocapConformance(SourceConformance):
    """What a motion-capture system is held to."""

    kind = "mocap"
    stream = "mocap/"


def _few(epochs: npt.NDArray[np.uint32]) -> str:
    """The different ones, or how many there are."""
    found = sorted(set(epochs.tolist()))
    return str(found) if len(found) < 10 else f"{found[:3]} and {len(found) - 3} others"
