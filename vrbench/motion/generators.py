"""Motions made by rule: each is fixed for ever by its name, its version and its seed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from vrbench.errors import ConfigError
from vrbench.geometry import Floats, Transform, rotvec_to_quat
from vrbench.motion.motion import Motion, relative_to_first
from vrbench.trajectory import NS, Trajectory

RATE_HZ = 120
# The calibration motion: how far its channels go, position [m] and rotation vector [rad], how long.
REACH = np.concatenate(([0.36, 0.14, 0.20], np.radians([30.0, 45.0, 24.0])))
SATURATE_S = 120.0


def _quintic(u: Floats) -> Floats:
    """The minimum-jerk course from 0 to 1 (Flash and Hogan, 1985), held outside 0..1."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def _darts(
    rng: np.random.Generator, t: Floats, reach: Floats, pause_s: float, rise_s: tuple[float, float]
) -> Floats:
    """Minimum-jerk moves (n, k) between random postures within +-reach (k,), with pauses."""
    posture, course = np.zeros(len(reach)), np.zeros((len(t), len(reach)))
    start = rng.exponential(pause_s)
    while start < t[-1]:
        # most moves are small, a few cross the whole box: as in play
        goal = reach * np.clip(rng.normal(0.0, 0.40, len(reach)), -1.0, 1.0)
        rise = rng.uniform(*rise_s)
        course += _quintic((t - start) / rise)[:, None] * (goal - posture)
        posture = goal
        start += rise * rng.uniform(0.6, 1.0) + rng.exponential(pause_s)
    return course


def _sway(rng: np.random.Generator, t: Floats, rms: Floats, band_hz: tuple[float, float]) -> Floats:
    """Band-limited noise (n, k) of the given rms (k,): forty random tones a channel."""
    tones = 40
    low, high = np.log(band_hz)
    frequency = np.exp(rng.uniform(low, high, (tones, len(rms))))
    phase = rng.uniform(0.0, 2.0 * np.pi, (tones, len(rms)))
    waves = np.cos(2.0 * np.pi * frequency * t[:, None, None] + phase)
    return waves.sum(axis=1) * rms * np.sqrt(2.0 / tones)


def _rest_at_ends(t: Floats, course: Floats, rest_s: float, ramp_s: float) -> Floats:
    """The course (n, k) taken from zero and back to zero, still for `rest_s` at both ends."""
    rise = _quintic((t - rest_s) / ramp_s)
    fall = _quintic((t[-1] - rest_s - t) / ramp_s)
    return course * (rise * fall)[:, None]


def _motion(name: str, title: str, t: Floats, course: Floats) -> Motion:
    """A motion of columns (n, 6): position [m], rotation vector [rad]; y up, -z ahead."""
    stamps = np.rint(t * NS).astype(np.int64)
    poses = Transform(course[:, :3], rotvec_to_quat(course[:, 3:]))
    return Motion(name, title, relative_to_first(Trajectory(stamps, poses)), "generated")


def shooter() -> Motion:
    """A seated player of a shooter: two minutes with the statistics of a real one.

    Modelled on the paper's recording of a real player: speed 0.17 rms and 0.88 max m/s,
    30 deg/s rms, a box of 0.64 x 0.20 x 0.31 m, power below 5 Hz.
    """
    rng = np.random.default_rng(13)
    t = np.arange(120 * RATE_HZ + 1) / RATE_HZ
    position = _darts(rng, t, np.array([0.31, 0.12, 0.15]), 0.6, (0.75, 1.5))
    position += _sway(rng, t, np.array([0.008, 0.004, 0.006]), (0.15, 1.5))
    rotation = _darts(rng, t, np.radians([22.0, 38.0, 14.0]), 0.9, (0.55, 1.1))
    rotation += _sway(rng, t, np.radians([1.2, 1.5, 0.8]), (0.2, 3.0))
    course = _rest_at_ends(t, np.column_stack((position, rotation)), 2.0, 2.0)
    return _motion("shooter-1", "Seated player of a shooter, generated", t, course)


def saturate() -> Motion:
    """The calibration motion: slow, about and along all axes, beyond the suites' motions."""
    return saturating("saturate-1", "Calibration: all axes, slow, 120 s", SATURATE_S)


def saturate_short() -> Motion:
    """The check motion: the calibration motion's first half minute, come to rest."""
    return saturating("saturate-30s-1", "Check: all axes, slow, 30 s", 30.0)


def saturating(
    name: str, title: str, duration_s: float, reach: Floats = REACH, slower: float = 1.0
) -> Motion:
    """Slow turns and moves about and along all axes.

    Args:
        name: name and version.
        title: for people.
        duration_s: how long, before it is slowed down [s].
        reach: how far position and rotation vector go (6,) [m, rad].
        slower: times as long, and so much slower.
    """
    duration_s *= slower
    t = np.arange(round(duration_s * RATE_HZ) + 1) / RATE_HZ
    # Two tones a channel, none a multiple of another, so that no axis moves with another. A tracker
    # errs slowly, so X is told by turns that are quicker than its errors: the second tones of
    # rotation are as quick as stays below 0.5 m/s and 90 deg/s with the flange 0.3 m away.
    slow = np.array([0.067, 0.083, 0.073, 0.097, 0.071, 0.089])
    fast = np.array([0.117, 0.139, 0.127, 0.389, 0.353, 0.431])
    of_slow = np.array([0.66, 0.66, 0.66, 0.60, 0.60, 0.60])
    of_fast = np.array([0.40, 0.40, 0.40, 0.45, 0.45, 0.45])
    angle = 2.0 * np.pi * t[:, None] / slower
    course = reach * (of_slow * np.sin(angle * slow) + of_fast * np.sin(angle * fast + 1.0))
    return _motion(name, title, t, _rest_at_ends(t, course, 2.0 * slower, 3.0 * slower))


GENERATORS: dict[str, Callable[[], Motion]] = {
    "shooter-1": shooter,
    "saturate-1": saturate,
    "saturate-30s-1": saturate_short,
}


@cache
def generate(name: str) -> Motion:
    """The generated motion of this name.

    Raises:
        ConfigError: no generator has the name.
    """
    if name not in GENERATORS:
        known = ", ".join(sorted(GENERATORS))
        raise ConfigError(f"no motion is called {name!r}", field="motion", fix=f"there are {known}")
    return GENERATORS[name]()
