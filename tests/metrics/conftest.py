"""Takes of a known motion, with the errors a test asks for."""

from collections.abc import Callable

import numpy as np
import pytest

from vrbench.clocks import ClockMap
from vrbench.geometry import Transform, quat_multiply, rotvec_to_quat
from vrbench.metrics import tilt
from vrbench.metrics.scored import ScoredTake
from vrbench.streams import Columns, Samples
from vrbench.trajectory import NS, Trajectory

X = Transform.of([0.003, 0.087, 0.276], [0.7071, 0.02, 0.01, 0.7071])
Y = Transform.of([0.4, -0.3, 1.1], [0.3, 0.5, -0.2, 0.7])
START = 1_700_000_000 * NS


def motion(s: np.ndarray) -> Transform:
    """`T_base_tcp` at seconds (n,): slow turns and swings in all directions."""
    p = np.stack([0.3 * np.sin(0.9 * s), 0.2 * np.sin(1.3 * s + 1), 0.1 * np.cos(0.7 * s)], axis=1)
    r = np.stack([0.5 * np.sin(0.6 * s), 0.4 * np.sin(0.8 * s), 0.9 * np.sin(0.5 * s + 2)], axis=1)
    return Transform(p, rotvec_to_quat(r))


def make_take(
    duration: float = 20.0,
    *,
    rate: float = 72.0,
    path: Callable[[np.ndarray], Transform] = motion,
    spoil: Callable[[np.ndarray, Transform], Transform] = lambda _s, pose: pose,
    flags: Callable[[np.ndarray], np.ndarray] | None = None,
    keep: Callable[[np.ndarray], np.ndarray] = lambda s: np.ones(len(s), dtype=bool),
    **more,
) -> ScoredTake:
    """A take whose poses are `spoil(seconds, T_base_eye)` in the headset's world."""
    reference_s = np.arange(0, duration + 1e-9, 0.01)
    reference = Trajectory(START + np.rint(reference_s * NS).astype(np.int64), path(reference_s))
    s = np.arange(0, duration, 1 / rate)
    s = s[keep(s)]
    t = START + np.rint(s * NS).astype(np.int64)
    samples = Samples.of(t, Y.inverse() @ spoil(s, path(s) @ X))
    if flags is not None:
        samples = Samples(t, t, t, samples.pose, flags(s).astype(np.uint32), samples.epoch)
    good = samples.good
    fields = {
        "columns": Columns({"robot/tcp": Samples.of(reference.t, reference.pose)}),
        "reference": reference,
        "samples": samples,
        "estimate": samples.trajectory(),
        "truth": path(s[good]),
        "clock": ClockMap.affine(START, 0.0),
        "x": X,
        "y": Y,
    }
    return ScoredTake(**(fields | more))


@pytest.fixture(name="make_take", scope="session")
def _make_take():
    return make_take


@pytest.fixture
def values():
    """Runs a family on a take: values by (metric, point, band, statistic), each checked."""

    def run(family, take):
        found = {}
        for value in family.of_take(take):
            key = (value.metric, value.point, value.band, value.statistic)
            assert key not in found
            assert family.units[value.metric] == value.unit
            assert (value.value is None) == bool(value.reason)
            assert value.value is None or np.isfinite(value.value)
            found[key] = value
        return found

    return run


def moved(samples, seconds, mm=(0, 0, 0)):
    t = samples.pose_t + round(seconds * NS)
    return Samples.of(t, Transform(samples.pose.p + np.array(mm) / 1e3, samples.pose.q))


def stop_and_go(s, speed=0.2):
    """Moves, rests from 5 s to 15 s, moves."""
    moving = np.clip(s, 0, 5) + np.clip(s - 15, 0, None)
    p = np.stack([speed * np.sin(moving), speed * moving, 0 * s], axis=1)
    return Transform(p, rotvec_to_quat(np.stack([0 * s, 0.1 * moving, 0 * s], axis=1)))


def leaning(rate_rad_per_s, axis):
    """Errors of rotation about an axis of base, growing at a rate."""

    def spoil(s, pose):
        turn = rotvec_to_quat(np.outer(rate_rad_per_s * s, axis))
        return Transform(pose.p, quat_multiply(turn, pose.q))

    return spoil


def up_of(take):
    return tilt.up_in_base(take.truth @ take.x, take.estimate.pose)[0]


@pytest.fixture(name="moved", scope="session")
def _moved():
    return moved


@pytest.fixture(name="stop_and_go", scope="session")
def _stop_and_go():
    return stop_and_go


@pytest.fixture(name="leaning", scope="session")
def _leaning():
    return leaning


@pytest.fixture(name="up_of", scope="session")
def _up_of():
    return up_of
