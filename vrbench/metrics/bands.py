"""An error split into what is slower and what is faster than a frequency."""

from __future__ import annotations

import numpy as np

from vrbench.errors import EstimationError
from vrbench.geometry import Floats, Ints
from vrbench.trajectory import MAX_GAP_PERIODS, NS

SPLIT_HZ = 2.0
# Two seconds of Hann-windowed sinc: the transition is about 1.5 Hz wide, -6 dB at the split.
KERNEL_S = 2.0


def slow_part(t: Ints, error: Floats) -> Floats:
    """The part of an error below `SPLIT_HZ`, without delay; what is above is the rest of it.

    A windowed-sinc filter over the samples of each stretch without a gap, mirrored at its ends.

    Args:
        t: stamps (n,) [ns], at a steady rate but for gaps.
        error: error vectors (n, k).

    Raises:
        EstimationError: too few samples, or a rate under four times the split.
    """
    if len(t) < 2:
        raise EstimationError(f"{len(t)} samples can't be split into bands")
    steps = np.diff(t)
    period_s = float(np.median(steps)) / NS
    if period_s * SPLIT_HZ * 4 > 1:
        raise EstimationError(
            f"{1 / period_s:.3g} Hz of samples can't be split at {SPLIT_HZ:g} Hz",
            fix="at least four times as many",
        )
    half = round(KERNEL_S / 2 / period_s)
    offsets = np.arange(-half, half + 1) * period_s
    kernel = np.sinc(2 * SPLIT_HZ * offsets) * np.hanning(2 * half + 3)[1:-1]
    kernel /= kernel.sum()
    slow = np.empty_like(error)
    gaps = np.flatnonzero(steps > MAX_GAP_PERIODS * period_s * NS) + 1
    for stretch in np.split(np.arange(len(t)), gaps):
        mirrored = np.pad(error[stretch], ((half, half), (0, 0)), mode="symmetric")
        for axis in range(error.shape[1]):
            slow[stretch, axis] = np.convolve(mirrored[:, axis], kernel, mode="valid")
    return slow
