"""A known movement proves handedness, axes, order and unit: what came against what was shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from vrbench.geometry import Axes, Floats, Transform, quat_conjugate, relative_angle

# A pose that was shown and came back is as near as the stamps are: 10 ms at 0.5 m/s and 1 rad/s.
NEAR_M, NEAR_RAD = 0.006, np.radians(0.8)
SEARCH_S, STEP_S = 0.3, 0.01
KEPT = 60
AXES = ("x", "-x", "y", "-y", "z", "-z")
UNITS = {
    "": 1.0,
    ", in cm": 0.01,
    ", in mm": 0.001,
    ", in inches": 0.0254,
    ", in feet": 0.3048,
    ", 10 times too small": 10.0,
    ", 100 times too small": 100.0,
    ", 1000 times too small": 1000.0,
    ", 10 times too large": 0.1,
}
# At times since the beginning (n,) [s], the poses (n,) that were shown.
Shown = Callable[[Floats], Transform]


@dataclass(frozen=True, slots=True)
class Match:
    """How well poses match those shown.

    Attributes:
        offset_s: the poses' stamps minus the recorder's clock [s].
        distance_m: median distance [m].
        angle_rad: median angle [rad].
    """

    offset_s: float
    distance_m: float
    angle_rad: float

    @property
    def good(self) -> bool:
        return self.distance_m < NEAR_M and self.angle_rad < NEAR_RAD


def match(shown: Shown, s: Floats, pose: Transform, around_s: float = 0.0) -> Match:
    """The best match over small offsets of the stamps.

    Args:
        shown: what was shown at a time.
        s: times of the poses (n,) [s].
        pose: poses that came (n,).
        around_s: an offset to look about [s].
    """
    coarse = around_s + np.arange(-SEARCH_S, SEARCH_S + STEP_S / 2, STEP_S)
    best = min((_at(shown, s, pose, offset) for offset in coarse), key=_size)
    fine = best.offset_s + np.arange(-STEP_S, STEP_S, STEP_S / 20)
    return min((_at(shown, s, pose, offset) for offset in fine), key=_size)


def _at(shown: Shown, s: Floats, pose: Transform, offset_s: float) -> Match:
    true = shown(s - offset_s)
    distance = np.linalg.norm(pose.p - true.p, axis=1)
    return Match(
        float(offset_s),
        float(np.median(distance)),
        float(np.median(relative_angle(pose.q, true.q))),
    )


def _size(found: Match) -> float:
    return found.distance_m + 0.3 * found.angle_rad


def diagnosis(shown: Shown, s: Floats, pose: Transform, around_s: float = 0.0) -> str:
    """What would have to be done to poses that don't match, in a sentence."""
    few = np.unique(np.linspace(0, len(s) - 1, KEPT).astype(int))
    s, pose = s[few], pose[few]
    offsets = around_s + np.arange(-SEARCH_S, SEARCH_S + 0.01, 0.02)
    truths = [shown(s - offset) for offset in offsets]
    p = min(
        ((_least([t.p for t in truths], there), told) for told, there in _positions(pose)),
        key=lambda found: found[0],
    )
    q = min(
        ((_least_angle([t.q for t in truths], there), told) for told, there in _rotations(pose)),
        key=lambda found: found[0],
    )
    # the steps of this search are coarse
    position = p[1] if p[0] < 0.03 else "unlike any convention"
    rotation = q[1] if q[0] < np.radians(4.0) else "unlike any convention"
    return f"positions are {position}; rotations are {rotation}"


def _least(truths: list[Floats], p: Floats) -> float:
    return min(float(np.median(np.linalg.norm(p - true, axis=1))) for true in truths)


def _least_angle(truths: list[Floats], q: Floats) -> float:
    return min(float(np.median(relative_angle(q, true))) for true in truths)


def _conventions() -> Iterator[tuple[str, Axes]]:
    """Every convention of axes, OpenXR's own first: of equals the first is told."""
    yield "as they should be", Axes("y", "-z")
    for hand, up, forward in product(("right", "left"), AXES, AXES):
        if up[-1] != forward[-1] and (hand, up, forward) != ("right", "y", "-z"):
            yield f"{hand}-handed with {up} up and {forward} forward", Axes(up, forward, hand)


def _positions(pose: Transform) -> Iterator[tuple[str, Floats]]:
    for (told, axes), (unit, metres) in product(_conventions(), UNITS.items()):
        yield f"{told}{unit}", axes.to_openxr(pose).p * metres


def _rotations(pose: Transform) -> Iterator[tuple[str, Floats]]:
    orders = {"": pose.q, ", in the order w x y z": pose.q[:, [1, 2, 3, 0]]}
    for (told, axes), (order, q) in product(_conventions(), orders.items()):
        turned = axes.to_openxr(Transform(pose.p, q)).q
        yield f"{told}{order}", turned
        yield f"{told}{order}, and inverse", quat_conjugate(turned)
