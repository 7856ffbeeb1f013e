"""Scale: by which factor the headset's metres are to be multiplied to be the reference's."""

from __future__ import annotations

from collections.abc import Iterator

from vrbench.errors import EstimationError
from vrbench.estimation.alignment import umeyama_scale
from vrbench.metrics.compared import NO_X
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent


def of_take(take: ScoredTake) -> Iterator[Value]:
    """Reference over estimate, at each point; reported, never aligned away."""
    if take.x is None:
        yield absent("scale", "1", NO_X, statistic="value")
        return
    for point, truth, estimate in take.points():
        try:
            found = umeyama_scale(truth.p, estimate.p)
        except EstimationError as error:
            yield absent("scale", "1", str(error), statistic="value", point=point)
        else:
            yield Value("scale", "value", found, "1", len(truth), point=point)


FAMILY = Family(
    name="scale",
    title="The factor between the headset's metres and the reference's",
    units={"scale": "1"},
    of_take=of_take,
    needs=frozenset({"x"}),
)
