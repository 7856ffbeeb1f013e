"""Scale: by which factor the headset's metres are to be multiplied to be the reference's."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.errors import EstimationError
from vrbench.estimation.alignment import align
from vrbench.geometry import Floats
from vrbench.metrics.compared import NO_X
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent


def scale(reference_p: Floats, estimate_p: Floats) -> float:
    """The scale of the similarity that brings the estimate onto the reference (Umeyama, 1991).

    Args:
        reference_p: points (n, 3) [m].
        estimate_p: the same points (n, 3) [m] in the estimate's frame.

    Raises:
        EstimationError: the positions do not determine an alignment.
    """
    rigid = align(reference_p, estimate_p)
    turned = rigid.apply(estimate_p)
    turned, fixed = turned - turned.mean(axis=0), reference_p - reference_p.mean(axis=0)
    # At the best rotation, which scale doesn't change, the best scale is a plain regression.
    return float(np.sum(fixed * turned) / np.sum(turned * turned))


def of_take(take: ScoredTake) -> Iterator[Value]:
    """Reference over estimate, at each point; reported, never aligned away."""
    if take.x is None:
        yield absent("scale", "1", NO_X, statistic="value")
        return
    for point, truth, estimate in take.points():
        try:
            found = scale(truth.p, estimate.p)
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
