"""Random errors that are functions of time: any instants may be asked for, in any order."""

from __future__ import annotations

from collections.abc import Callable
from zlib import crc32

import numpy as np

from vrbench.geometry import Bools, Floats

TONES = 96


def rng_of(seed: int, *names: str) -> np.random.Generator:
    """A generator of its own for each seed and name: one device's draws don't move another's."""
    return np.random.default_rng([seed, *(crc32(name.encode()) for name in names)])


def correlated(
    rng: np.random.Generator, rms: float, time_constant_s: float, channels: int
) -> Callable[[Floats], Floats]:
    """Gaussian noise with correlation exp(-|dt| / time constant), as a function of time.

    A sum of random tones drawn from the process's own (Lorentzian) spectrum, cut at 10 Hz
    (Shinozuka and Deodatis, 1991). The rms is that of an ensemble; a short stretch of slow noise
    has less about its own mean.

    Returns:
        from times (n,) [s] to values (n, channels).
    """
    corner = 1.0 / (2.0 * np.pi * time_constant_s)
    # One tone in each of equally likely bands of the spectrum, so that none is left out.
    chance = (np.arange(TONES)[:, None] + rng.uniform(size=(TONES, channels))) / TONES
    frequency = corner * np.tan(0.5 * np.pi * chance * (2.0 / np.pi) * np.arctan(10.0 / corner))
    phase = rng.uniform(0.0, 2.0 * np.pi, (TONES, channels))
    scale = rms * np.sqrt(2.0 / TONES)

    def at(t: Floats) -> Floats:
        value = np.zeros((len(t), channels))
        for f, shift in zip(frequency, phase, strict=True):
            value += np.cos(2.0 * np.pi * f * t[:, None] + shift)
        return scale * value

    return at


def losses(
    rng: np.random.Generator, per_minute: float, length_s: float
) -> Callable[[Floats], Bools]:
    """Random stretches of fixed length, Poisson in time.

    Returns:
        from times (n,) [s] to whether each lies in a stretch.
    """
    # Drawn four hours at a time, in their order, as far as anybody has asked.
    span_s, drawn = 4 * 3600.0, 0
    starts = np.zeros(0)

    def at(t: Floats) -> Bools:
        nonlocal starts, drawn
        while len(t) and t.max() >= drawn * span_s:
            count = rng.poisson(per_minute * span_s / 60.0)
            fresh = drawn * span_s + np.sort(rng.uniform(0.0, span_s, count))
            starts, drawn = np.concatenate((starts, fresh)), drawn + 1
        if not len(starts):
            return np.zeros(len(t), dtype=bool)
        before = np.searchsorted(starts, t, side="right") - 1
        inside: Bools = (before >= 0) & (t - starts[before] < length_s)
        return inside

    return at
