"""Uncertainty of a least-squares fit whose residuals are correlated in time."""

from __future__ import annotations

import numpy as np

from vrbench.geometry import Floats


def block_covariance(bread: Floats, scores: Floats) -> tuple[Floats, int]:
    """The sandwich covariance of parameters, its middle from overlapping blocks.

    Formal sigmas count every sample as news; at 72 Hz, with errors that last for seconds, that is
    ten times too small. Here the scores (gradients) are summed over blocks as long as the data
    ask for (`block_length`), and their scatter is propagated (Kuensch, 1989).

    Args:
        bread: inverse of the weighted normal matrix (k, k).
        scores: gradients of the cost summed over equal bins of time (n, k).

    Returns:
        The covariance (k, k), and the length of a block in bins.
    """
    influence = scores @ bread
    n, k = influence.shape
    longest = max(n // 8, 1)
    length = min(max(block_length(influence[:, j]) for j in range(k)), longest)
    running = np.concatenate((np.zeros((1, k)), np.cumsum(influence, axis=0)))
    sums = running[length:] - running[:-length]
    blocks = n / length
    # a block's sum loses what the whole's mean took: one block's worth of freedom
    factor = n / length / len(sums) * blocks / max(blocks - 1.0, 1.0)
    covariance: Floats = factor * sums.T @ sums
    return covariance, length


def block_length(x: Floats) -> int:
    """The best block length for the variance of the mean of a series (n,), in samples.

    Politis and White (2004) with the correction of Patton, Politis and White (2009): from the
    autocovariance up to twice the lag after which it stays insignificant.
    """
    n = len(x)
    x = x - x.mean()
    if n < 8 or not x.any():
        return 1
    size = 1 << int(np.ceil(np.log2(2 * n)))
    spectrum = np.fft.rfft(x, size)
    covariance = np.fft.irfft(spectrum * np.conj(spectrum), size)[: n // 2] / n
    significant = np.abs(covariance / covariance[0]) > 2.0 * np.sqrt(np.log10(n) / n)
    quiet = max(5, int(np.ceil(np.sqrt(np.log10(n)))))
    last = 0
    for lag in range(1, len(significant)):
        if significant[lag]:
            last = lag
        elif lag - last >= quiet:
            break
    reach = min(2 * max(last, 1), len(covariance) - 1)
    lags = np.arange(1, reach + 1)
    taper = np.minimum(1.0, 2.0 * (1.0 - lags / reach))
    slope = 2.0 * float(np.sum(taper * lags * covariance[1 : reach + 1]))
    power = covariance[0] + 2.0 * float(np.sum(taper * covariance[1 : reach + 1]))
    if power <= 0.0:
        return 1
    best = (2.0 * slope**2 / (4.0 / 3.0 * power**2)) ** (1 / 3) * n ** (1 / 3)
    return int(np.clip(np.ceil(best), 1, n))
