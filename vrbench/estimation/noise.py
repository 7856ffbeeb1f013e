"""What the residuals' own noise looks like, so that least squares can weigh them by it.

A headset's errors last for seconds: samples that follow each other tell nearly the same, and slow
motion tells less than fast motion. Least squares that takes them as independent is less accurate
than it could be, and believes itself ten times too accurate. Generalised least squares predicts
each residual from those before it, and fits what can't be predicted (Cochrane and Orcutt, 1949).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vrbench.geometry import Bools, Floats, Ints

# Errors are looked at in bins of a tenth of a second: motion is slower, and above 5 Hz a mount
# vibrates, and logs of 30 Hz can't tell.
BIN_S = 0.1
# How far back a prediction looks, in bins.
MEMORY = 5
# A bin with less than this part of the usual weight is unknown.
LEAST_WEIGHT = 0.3
ROWS_A_LAG = 20
CHUNK = 4096


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """An autoregressive model of a residual with three axes, alike in all of them.

    Attributes:
        coefficients: of the bins before, the last first (p,).
        variance: of what they don't predict, each axis.
    """

    coefficients: Floats
    variance: float

    def rows(self, known: Bools) -> Ints:
        """Which bins (c,) of known (b,) have all known before them that a prediction needs."""
        return with_past(known, len(self.coefficients))

    def whitened(self, values: Floats, rows: Ints) -> Floats:
        """What isn't predicted of values (b, ...) at rows (c,), in standard deviations (c, ...)."""
        news = values[rows]
        for lag, coefficient in enumerate(self.coefficients, start=1):
            news = news - coefficient * values[rows - lag]
        whitened: Floats = news / np.sqrt(self.variance)
        return whitened

    def scattered(self, values: Floats) -> Floats:
        """The covariance (k, k) of values (b, 3, k) times such noise, summed over bins and axes."""
        size = 1 << int(np.ceil(np.log2(2 * len(values))))
        filtered = np.fft.rfft(np.concatenate(([1.0], -self.coefficients)), size)
        density = self.variance / np.abs(filtered) ** 2
        # real sequences: all frequencies but the first and the last stand for two
        density[1:-1] *= 2.0
        parts = np.fft.rfft(values, size, axis=0)
        total: Floats = np.einsum("fck,f,fcl->kl", parts, density, parts.conj(), optimize=True).real
        return total / size


def with_past(known: Bools, lags: int) -> Ints:
    """Which bins (c,) of known (b,) are known, and so many before each as well."""
    run = np.cumsum(known)
    before = np.concatenate((np.zeros(lags + 1, dtype=run.dtype), run))[: len(run)]
    rows = np.flatnonzero(run - before == lags + 1)
    return rows[rows >= lags]


def estimate_noise(residual: Floats, known: Bools, spread: Floats) -> Noise:
    """The noise behind residuals of a fit.

    A fit takes out of the noise what looks like its parameters, mostly where the motion is. What it
    took is known in the mean: `spread` is added to the residuals' own products, as the
    expectation step of maximum likelihood does (Dempster, Laird and Rubin, 1977).

    The model is the conditional least-squares one, of the order that Akaike's criterion, corrected
    for few samples, prefers.

    Args:
        residual: in equal bins of time (b, 3).
        known: which bins are (b,).
        spread: derivatives of the residual by the parameters, times a root of the parameters'
            covariance (b, 3, k).
    """
    # residuals of nought, as of a stream against itself, have no correlation
    most = int(min(MEMORY, known.sum() // ROWS_A_LAG)) if residual.any() else 0
    rows = with_past(known, most)
    if len(rows) < ROWS_A_LAG * (most + 1) // 2:
        most, rows = 0, np.flatnonzero(known)
    products = np.zeros((most + 1, most + 1))
    series = np.concatenate((residual[:, :, None], spread), axis=2).reshape(len(known), -1)
    for start in range(0, len(rows), CHUNK):
        part = rows[start : start + CHUNK]
        lagged = np.stack([series[part - lag].ravel() for lag in range(most + 1)])
        products += lagged @ lagged.T
    count = 3 * len(rows)
    best: tuple[float, Floats, float] | None = None
    for p in range(most + 1):
        past, cross = products[1 : p + 1, 1 : p + 1], products[1 : p + 1, 0]
        coefficients = np.linalg.solve(past + 1e-12 * np.trace(past) * np.eye(p), cross)
        variance = float(products[0, 0] - cross @ coefficients) / count
        variance = max(variance, 1e-24)
        freedom = max(count - p - 2, 1)
        score = count * np.log(variance) + 2.0 * (p + 1) * count / freedom
        if best is None or score < best[0]:
            best = (score, coefficients, variance * count / max(count - p, 1))
    assert best is not None
    return Noise(best[1], best[2])
