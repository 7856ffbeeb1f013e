"""Hand-eye: what is left over of the poses of a calibration under its own X."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.geometry import Floats, Transform, quat_angle
from vrbench.metrics.compared import MM, NO_X
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent, summarise

UNITS = {
    "handeye.translation": "mm",
    "handeye.rotation": "deg",
    "handeye.translation.to_first": "mm",
    "handeye.rotation.to_first": "deg",
}


def residuals(
    truth: Transform, estimate: Transform, x: Transform, y: Transform
) -> tuple[Floats, Floats]:
    """Pose residuals `(T_base_tcp X)^-1 Y T_world_eye`, at the eye.

    Args:
        truth: `T_base_tcp` (n,).
        estimate: `T_world_eye` (n,).
        x: `T_tcp_eye`.
        y: `T_base_world`.

    Returns:
        Translations (n,) [m] and angles (n,) [rad].
    """
    left = (truth @ x).inverse() @ (y @ estimate)
    return np.linalg.norm(left.p, axis=1), quat_angle(left.q)


def residuals_to_first(
    truth: Transform, estimate: Transform, x: Transform
) -> tuple[Floats, Floats]:
    """Residuals of the motion since the first pose, at the tcp.

    `D_i = (X U_0^-1 U_i X^-1)^-1 (O_0^-1 O_i)` with `U = T_world_eye`, `O = T_base_tcp`: Banaszczyk
    et al., How Accurate is the Positioning in VR?, ISMAR-Adjunct 2024. The errors of the first pose
    are part of every one.

    Args:
        truth: `T_base_tcp` (n,).
        estimate: `T_world_eye` (n,).
        x: `T_tcp_eye`.

    Returns:
        Translations (n,) [m] and angles (n,) [rad].
    """
    moved = x @ (estimate[0].inverse() @ estimate) @ x.inverse()
    left = moved.inverse() @ (truth[0].inverse() @ truth)
    return np.linalg.norm(left.p, axis=1), quat_angle(left.q)


def of_take(take: ScoredTake) -> Iterator[Value]:
    """Both kinds of residuals; they tell of a calibration where the take is one."""
    if take.x is None or take.y is None or len(take.estimate) == 0:
        reason = NO_X if take.x is None or take.y is None else "no samples in the window"
        yield from (absent(name, unit, reason) for name, unit in UNITS.items())
        return
    pose = take.estimate.pose
    for suffix, point, (translation, rotation) in (
        ("", "eye", residuals(take.truth, pose, take.x, take.y)),
        (".to_first", "tcp", residuals_to_first(take.truth, pose, take.x)),
    ):
        yield from summarise(f"handeye.translation{suffix}", MM * translation, "mm", point=point)
        yield from summarise(f"handeye.rotation{suffix}", np.degrees(rotation), "deg", point=point)


FAMILY = Family(
    name="handeye",
    title="What is left over of the poses of a calibration under its own X",
    units=UNITS,
    of_take=of_take,
    needs=frozenset({"x"}),
)
