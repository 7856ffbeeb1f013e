"""The spectrum of an error, by Welch's method, thinned for display."""

from __future__ import annotations

import numpy as np

from vrbench.geometry import Bools, Floats, Ints
from vrbench.results.plot_data import Spectrum, few
from vrbench.trajectory import NS

SPECTRUM_POINTS = 120
# Errors of tracking last for seconds: a segment holds several such, a take several segments.
SEGMENT_S, LEAST_SEGMENTS = 60.0, 4


def spectrum(t: Ints, error: Floats) -> Spectrum | None:
    """Amplitude spectral density of an error vector, by Welch's method.

    Hann windows that overlap by half, over the samples interpolated to an even rate; the power of
    the axes is added. None for a take too short for it.

    Args:
        t: stamps (n,) [ns].
        error: error vectors (n, 3) [mm].
    """
    if len(t) < 2:
        return None
    period_s = float(np.median(np.diff(t))) / NS
    seconds = (t - t[0]) / NS
    even = np.arange(0.0, seconds[-1], period_s)
    size = int(min(SEGMENT_S, seconds[-1] / LEAST_SEGMENTS) / period_s)
    if size < 64:
        return None
    window = np.hanning(size)
    scale = 2.0 * period_s / float(np.sum(window**2))
    power, count = np.zeros(size // 2 + 1), 0
    values = np.stack([np.interp(even, seconds, axis) for axis in error.T])
    for begin in range(0, len(even) - size + 1, size // 2):
        part = values[:, begin : begin + size]
        part = (part - part.mean(axis=1, keepdims=True)) * window
        power += np.sum(np.abs(np.fft.rfft(part, axis=1)) ** 2, axis=0)
        count += 1
    hz: Floats = np.fft.rfftfreq(size, period_s)[1:].astype(np.float64)
    return _log_spaced(hz, scale * power[1:] / count)


def _log_spaced(hz: Floats, power: Floats) -> Spectrum:
    """The mean power in equal steps of the frequency's logarithm, as an amplitude."""
    edges = np.geomspace(hz[0], hz[-1], SPECTRUM_POINTS + 1)
    at = np.clip(np.searchsorted(edges, hz, side="right") - 1, 0, SPECTRUM_POINTS - 1)
    n = np.bincount(at, minlength=SPECTRUM_POINTS)
    some: Bools = n > 0
    total = np.bincount(at, power, minlength=SPECTRUM_POINTS)
    middle = np.bincount(at, hz, minlength=SPECTRUM_POINTS)
    return Spectrum(hz=few(middle[some] / n[some]), density=few(np.sqrt(total[some] / n[some])))
