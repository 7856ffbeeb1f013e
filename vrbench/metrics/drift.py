"""Drift: how fast the error grows over a long take."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.errors import EstimationError
from vrbench.estimation.drift import LONG_TAKE_S
from vrbench.geometry import Floats
from vrbench.metrics.compared import MM, aligned_eye
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.robust import theil_sen
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent
from vrbench.metrics.tilt import up_in_base

UNITS = {"drift.translation": "mm/h", "drift.yaw": "deg/h", "drift.tilt": "deg/h"}


def of_take(take: ScoredTake) -> Iterator[Value]:
    """Theil-Sen slopes of the eye's error, axis by axis.

    Translation and tilt are the lengths of their slope vectors, so never negative; yaw is signed,
    positive about up. A take that repeats its motion has none here: its drift is told loop by loop.
    """
    if any(event.kind == "loop" for event in take.columns.events):
        return
    try:
        slopes, n = _slopes(take)
    except EstimationError as error:
        for name, unit in UNITS.items():
            yield absent(name, unit, str(error), statistic="slope", point="eye")
        return
    for name, slope in slopes.items():
        yield Value(name, "slope", slope, UNITS[name], n, point="eye")


def _slopes(take: ScoredTake) -> tuple[dict[str, float], int]:
    if take.estimate.duration_s < LONG_TAKE_S:
        raise EstimationError(
            f"the take lasts {take.estimate.duration_s:.4g} s", fix=f"drift needs {LONG_TAKE_S:g} s"
        )
    eye = aligned_eye(take)
    hours = take.estimate.seconds(int(take.estimate.t[0])) / 3600
    rotation = np.degrees(eye.rotation())
    up = up_in_base(eye.truth, take.estimate.pose).mean(axis=0)
    up /= np.linalg.norm(up)
    about_up = rotation @ up
    return {
        "drift.translation": _length(hours, MM * eye.translation()),
        "drift.yaw": theil_sen(hours, about_up),
        "drift.tilt": _length(hours, rotation - np.outer(about_up, up)),
    }, len(hours)


def _length(hours: Floats, error: Floats) -> float:
    return float(np.linalg.norm([theil_sen(hours, axis) for axis in error.T]))


FAMILY = Family(
    name="drift",
    title="How fast the error grows over a long take",
    units=UNITS,
    of_take=of_take,
    needs=frozenset({"x"}),
)
