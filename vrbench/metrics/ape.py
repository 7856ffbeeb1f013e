"""Absolute pose error: how far the headset is from where it is, in one frame for the whole take."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Transform
from vrbench.metrics.bands import slow_part
from vrbench.metrics.compared import MM, Compared, aligned, at_samples, fit_poses, under
from vrbench.metrics.pose_errors import ape_rotation, ape_translation
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.robust import theil_sen
from vrbench.metrics.scored import ScoredTake
from vrbench.metrics.summary import absent, summarise
from vrbench.trajectory import Trajectory

T, R = "ape.translation", "ape.rotation"
UNITS = {
    f"{T}.aligned": "mm",
    f"{T}.anchored": "mm",
    f"{T}.sitting": "mm",
    f"{T}.by_speed": "mm/(m/s)",
    f"{R}.aligned": "deg",
    f"{R}.anchored": "deg",
    f"{R}.sitting": "deg",
    f"{R}.by_speed": "ms",
}


def of_take(take: ScoredTake) -> Iterator[Value]:
    """APE under the three alignments, its slope against speed, and its bands."""
    for alignment, compute in (
        ("aligned", _aligned),
        ("anchored", _anchored),
        ("sitting", _sitting),
    ):
        try:
            yield from list(compute(take))
        except EstimationError as error:
            for metric in (T, R):
                name = f"{metric}.{alignment}"
                yield absent(name, UNITS[name], str(error))


def _aligned(take: ScoredTake) -> Iterator[Value]:
    for compared in aligned(take):
        yield from _errors("aligned", compared)
        yield from _bands(take, compared)
        yield from _by_speed(take, compared)


def _anchored(take: ScoredTake) -> Iterator[Value]:
    """Y from positions and rotations of the eye in the anchor window, which isn't scored.

    It has no interval: most of its error is the chance of one short window, and a take has one of
    it. So it is with the sitting's, whose chance is the calibration's and what drifts since.
    """
    if take.anchor_end is None:
        raise EstimationError("the case has no anchor window")
    anchor = take.estimate.t <= take.anchor_end
    if not anchor.any() or anchor.all():
        raise EstimationError("the anchor window leaves no samples to fit on, or none to score")
    eye = next(under(take, Transform.identity()))
    y = fit_poses(eye.truth[anchor], eye.estimate[anchor])
    for at in under(take, y):
        yield from _errors("anchored", Compared(at.point, at.truth[~anchor], at.estimate[~anchor]))


def _sitting(take: ScoredTake) -> Iterator[Value]:
    """Y from the calibration before the take: what its world drifted since then is an error."""
    if take.sitting_y is None:
        raise EstimationError(take.no_sitting)
    for compared in under(take, take.sitting_y):
        yield from _errors("sitting", compared)


def _errors(alignment: str, at: Compared) -> Iterator[Value]:
    distance = MM * ape_translation(at.truth, at.estimate)
    angle = np.degrees(ape_rotation(at.truth, at.estimate))
    yield from summarise(f"{T}.{alignment}", distance, "mm", point=at.point)
    yield from summarise(f"{R}.{alignment}", angle, "deg", point=at.point)


def _bands(take: ScoredTake, at: Compared) -> Iterator[Value]:
    error = MM * at.translation()
    name = f"{T}.aligned"
    try:
        slow = slow_part(take.estimate.t, error)
    except EstimationError as problem:
        for band in ("<2Hz", ">2Hz"):
            yield absent(name, "mm", str(problem), point=at.point, band=band)
        return
    for band, part in (("<2Hz", slow), (">2Hz", error - slow)):
        yield from summarise(name, np.linalg.norm(part, axis=1), "mm", point=at.point, band=band)


def _by_speed(take: ScoredTake, at: Compared) -> Iterator[Value]:
    """Slopes of the errors against the true speed and angular speed; deg per deg/s is a time."""
    moving = Trajectory(take.estimate.t, at.truth)
    distance, angle = ape_translation(at.truth, at.estimate), ape_rotation(at.truth, at.estimate)
    for metric, speed, error in (
        (f"{T}.by_speed", at_samples(moving.speed()), MM * distance),
        (f"{R}.by_speed", at_samples(moving.angular_speed()), 1e3 * angle),
    ):
        try:
            slope = theil_sen(speed, error)
        except EstimationError as problem:
            yield absent(metric, UNITS[metric], str(problem), statistic="slope", point=at.point)
        else:
            yield Value(metric, "slope", slope, UNITS[metric], len(error), point=at.point)


FAMILY = Family(
    name="ape",
    title="Absolute pose error: how far the headset is from where it is",
    units=UNITS,
    of_take=of_take,
    needs=frozenset({"x"}),
)
