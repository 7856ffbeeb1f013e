"""Hand-eye: what is left over of the poses of a calibration under its own X."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.estimation.handeye import paper_residual, residuals
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


def of_take(take: ScoredTake) -> Iterator[Value]:
    """Residuals of each pose at the eye, and the mean of the motion since the first one.

    The latter is the paper's (Banaszczyk et al., ISMAR-Adjunct 2024), at the tcp; the errors of the
    first pose are part of all. They tell of a calibration where the take is one.
    """
    if take.x is None or take.y is None or len(take.estimate) == 0:
        reason = NO_X if take.x is None or take.y is None else "no samples in the window"
        yield from (absent(name, unit, reason) for name, unit in UNITS.items())
        return
    n, pose = len(take.estimate), take.estimate.pose
    distance, angle = residuals(take.truth, pose, take.x, take.y)
    yield from summarise("handeye.translation", MM * distance, "mm", point="eye")
    yield from summarise("handeye.rotation", np.degrees(angle), "deg", point="eye")
    mean_m, mean_rad = paper_residual(take.truth, pose, take.x)
    first = {"handeye.translation.to_first": MM * mean_m}
    first["handeye.rotation.to_first"] = float(np.degrees(mean_rad))
    for name, mean in first.items():
        yield Value(name, "mean", mean, UNITS[name], n, point="tcp")


FAMILY = Family(
    name="handeye",
    title="What is left over of the poses of a calibration under its own X",
    units=UNITS,
    of_take=of_take,
    needs=frozenset({"x"}),
)
