"""Sittings: a calibration's world frame in the takes of its mount, until somebody recentres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from vrbench.metrics.scored import ScoredTake
from vrbench.protocols.calibration import Calibration
from vrbench.protocols.protocol import world_of


def in_sitting(take: ScoredTake, calibrations: Sequence[Calibration], began: int) -> ScoredTake:
    """The take with `T_base_world` of the last calibration before it, or the first after.

    Args:
        take: made ready, of one epoch.
        calibrations: of its mount, none of which is the take's own.
        began: when it began, by the recorder's clock [ns].

    Returns:
        the take; where no calibration is known to share its world, with the reason.
    """
    world = world_of(take.columns)
    if world is None:
        return replace(take, no_sitting="the recording doesn't say which world its poses are in")
    there = sorted((c for c in calibrations if c.world == world), key=lambda c: c.start)
    if there:
        before = [c for c in there if c.start <= began]
        return replace(take, sitting_y=before[-1].y if before else there[0].y)
    others = ", ".join(c.take for c in calibrations)
    if not others:
        return take
    return replace(
        take,
        no_sitting=f"the headset's world is another one than in {others}: it recentred in "
        "between, or was started anew",
    )
