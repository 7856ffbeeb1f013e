"""Random errors that are functions of time: any instants may be asked for, in any order."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from zlib import crc32

import numpy as np

from vrbench.geometry import Bools, Floats

# Between instants this far apart noise is straight: what is quicker than 10 Hz is left out.
STEP_S = 0.05
# Noise is made in chunks this long, each from draws of its own, and of the one before it.
CHUNK_S = 60.0
# After so many time constants nothing is left of what was.
FORGOTTEN = 12.0


def rng_of(seed: int, *names: str) -> np.random.Generator:
    """A generator of its own for each seed and name: one device's draws don't move another's."""
    return np.random.default_rng([seed, *(crc32(name.encode()) for name in names)])


def correlated(
    rng: np.random.Generator, rms: float, time_constant_s: float, channels: int
) -> Callable[[Floats], Floats]:
    """Gaussian noise with correlation exp(-|dt| / time constant), as a function of time.

    An autoregressive process (of Ornstein and Uhlenbeck), straight between its steps. The rms is
    that of an ensemble; a short stretch of slow noise has less about its own mean.

    Returns:
        from times (n,) [s] to values (n, channels).
    """
    step_s = min(STEP_S, time_constant_s / 4.0)
    size = round(max(CHUNK_S, FORGOTTEN * time_constant_s) / step_s)
    stays = float(np.exp(-step_s / time_constant_s))
    # half way between two steps it varies by less
    scale = rms * np.sqrt(3.0 / (2.0 + stays))
    fading = scale * np.sqrt(1.0 - stays * stays) * stays ** np.arange(size)
    key = int(rng.integers(2**63))

    @cache
    def chunk(number: int) -> Floats:
        """The process at the steps of a chunk (size, channels)."""
        # numbers of chunks may be negative, seeds not
        news = np.concatenate(
            [
                np.random.default_rng([key, k % 2**63]).normal(size=(size, channels))
                for k in (number - 1, number)
            ]
        )
        # each step is the sum of `size` draws, the older the fainter
        spectrum = np.fft.rfft(news, axis=0) * np.fft.rfft(fading, 2 * size)[:, None]
        return np.fft.irfft(spectrum, 2 * size, axis=0)[size:]

    def at(t: Floats) -> Floats:
        if not len(t):
            return np.zeros((0, channels))
        first = int(np.floor(np.min(t) / step_s)) // size
        last = (int(np.floor(np.max(t) / step_s)) + 1) // size
        made = np.concatenate([chunk(number) for number in range(first, last + 1)])
        place = t / step_s
        left = np.floor(place).astype(np.int64)
        share = (place - left)[:, None]
        left -= first * size
        value: Floats = made[left] * (1.0 - share) + made[left + 1] * share
        return value

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
