"""Return to start: the error that has come up between the first and the last second."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Transform
from vrbench.metrics.compared import MM, fit_poses, under
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent
from vrbench.trajectory import NS

NAME = "return_to_start"
END_S = 1.0


def of_take(take: ScoredTake) -> Iterator[Value]:
    """The mean error vector's length in the last second, in the frame fitted on the first one."""
    try:
        yield from list(_at_points(take))
    except EstimationError as error:
        yield absent(NAME, "mm", str(error), statistic="last-first")


def _at_points(take: ScoredTake) -> Iterator[Value]:
    if take.estimate.duration_s < 2 * END_S:
        raise EstimationError(f"the take lasts less than {2 * END_S:g} s")
    since = (take.estimate.t - take.estimate.t[0]) / NS
    first, last = since <= END_S, since >= since[-1] - END_S
    for at in under(take, Transform.identity()):
        y = fit_poses(at.truth[first], at.estimate[first])
        error = (y @ at.estimate[last]).p - at.truth[last].p
        length = float(np.linalg.norm(error.mean(axis=0)))
        n = int(np.count_nonzero(first | last))
        yield Value(NAME, "last-first", MM * length, "mm", n, point=at.point)


FAMILY = Family(
    name="return_to_start",
    title="The error that has come up between the first and the last second",
    units={NAME: "mm"},
    of_take=of_take,
    needs=frozenset({"x"}),
)
