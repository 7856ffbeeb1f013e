"""Repeatability: how well the robot repeats itself; the headset has no part in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from vrbench.errors import EstimationError
from vrbench.metrics.compared import MM
from vrbench.metrics.lag import differences, find_lag
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent, summarise
from vrbench.trajectory import Trajectory

NAME = "repeatability.robot"


def executed(take: ScoredTake) -> Trajectory:
    """The robot's own log of its TCP within the window.

    Raises:
        EstimationError: the take has none.
    """
    samples = take.columns.poses.get("robot/tcp")
    if samples is None or len(take.reference) == 0:
        raise EstimationError("the take has no log of the robot's TCP")
    return samples.trajectory().between(int(take.reference.t[0]), int(take.reference.t[-1]))


def of_repeats(takes: Sequence[ScoredTake]) -> Iterator[Value]:
    """Distances of the TCP in later repeats to the first, at the same time of the motion.

    Time is aligned by the robot's logs themselves, space isn't.
    """
    try:
        if len(takes) < 2:
            raise EstimationError("there is one repeat only")
        first, *others = (executed(take) for take in takes)
        distances = [
            np.linalg.norm(differences(first, other, find_lag(first, other)), axis=1)
            for other in others
        ]
    except EstimationError as error:
        yield absent(NAME, "mm", str(error))
    else:
        yield from summarise(NAME, MM * np.concatenate(distances), "mm", point="tcp")


FAMILY = Family(
    name="repeatability",
    title="How well the robot repeats itself",
    units={NAME: "mm"},
    of_repeats=of_repeats,
)
