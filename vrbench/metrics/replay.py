"""Replay: whether the robot did the motion that was planned."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.errors import EstimationError
from vrbench.metrics.compared import MM
from vrbench.metrics.lag import differences, find_lag
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent, summarise
from vrbench.trajectory import Trajectory

UNITS = {"replay.fidelity": "mm", "replay.fraction": "%"}


def of_take(take: ScoredTake) -> Iterator[Value]:
    """Distance of the executed TCP to the planned one, and how much of the motion was done.

    The constant time by which the robot follows is taken out. The whole take counts, not only the
    window, since what was planned and left out is just what the fraction tells.
    """
    try:
        target, tcp = _stream(take, "robot/target"), _stream(take, "robot/tcp")
        lag = find_lag(target, tcp)
        distance = np.linalg.norm(differences(target, tcp, lag), axis=1)
    except EstimationError as error:
        yield absent("replay.fidelity", "mm", str(error))
        yield absent("replay.fraction", "%", str(error), statistic="value")
        return
    yield from summarise("replay.fidelity", MM * distance, "mm", point="tcp")
    planned = _fraction(take)
    if planned is None:
        reason = "the take does not say which fraction of the motion was planned"
        yield absent("replay.fraction", "%", reason, statistic="value")
    else:
        done = 100.0 * planned * len(distance) / len(target)
        yield Value("replay.fraction", "value", done, "%", len(target))


def _stream(take: ScoredTake, name: str) -> Trajectory:
    samples = take.columns.poses.get(name)
    if samples is None:
        raise EstimationError(f"the take has no stream {name}")
    return samples.trajectory()


def _fraction(take: ScoredTake) -> float | None:
    """The part of the motion that the plan holds, 0..1."""
    try:
        return float(take.columns.metadata["fraction"])
    except (KeyError, ValueError):
        return None


FAMILY = Family(
    name="replay",
    title="Whether the robot did the motion that was planned",
    units=UNITS,
    of_take=of_take,
    needs=frozenset({"target"}),
)
