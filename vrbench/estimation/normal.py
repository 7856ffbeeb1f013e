"""Normal equations of the model: of samples taken as independent, and whitened in bins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vrbench.errors import EstimationError
from vrbench.estimation.model import Model, State
from vrbench.estimation.noise import BIN_S, LEAST_WEIGHT, Noise, estimate_noise
from vrbench.estimation.robust import bisquare, scale_of
from vrbench.geometry import Bools, Floats, Ints

# Functions of time as a sparse matrix of scipy's.
Hats = Any

# Wide, so that the heavy tails of real tracking count almost in full, yet jumps not at all: under
# a scale that is free, even a little weight of a jump shrinks it.
CUT = 15.0
# How much of a slow residual stays with the parameters when drift is allowed.
DRIFT_SHARE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Normal:
    """The normal equations at a state.

    Attributes:
        bread: inverse of the weighted normal matrix (k, k).
        gradient: half the gradient of the cost (k,).
    """

    bread: Floats
    gradient: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Binned:
    """A residual with three axes and its derivatives, as robust means over bins of `BIN_S`.

    Attributes:
        residual: (b, 3).
        derivative: (b, 3, k).
        known: bins with samples enough (b,).
    """

    residual: Floats
    derivative: Floats
    known: Bools

    def moved(self, step: Floats) -> Binned:
        """The same after a small step (k,) in the parameters."""
        return Binned(self.residual + self.derivative @ step, self.derivative, self.known)

    def freed(self, following: Floats) -> Binned:
        """The same with residuals freed of what columns (b, 3, m) explain of them."""
        columns, residual = following[self.known], self.residual[self.known]
        inner = np.einsum("bcm,bcl->ml", columns, columns)
        share = np.linalg.pinv(inner, hermitian=True) @ np.einsum("bcm,bc->m", columns, residual)
        left = np.where(self.known[:, None], self.residual - following @ share, 0.0)
        return Binned(left, self.derivative, self.known)

    def noise(self, root: Floats) -> Noise:
        """The noise in it, given a root (k, k) of the parameters' covariance."""
        return estimate_noise(self.residual, self.known, self.derivative @ root)


def normal_equations(model: Model, state: State, information: Floats, pull: Floats) -> Normal:
    """The equations at a state, every sample taken as independent of all others.

    Args:
        information: of a Gaussian prior on the parameters (k, k).
        pull: the prior's part of the gradient (k,).
    """
    weights = [_weights(residual) for residual in model.residuals(state)]
    matrix, gradient = information.copy(), pull.copy()
    k = len(model.names)
    for part in model.chunks():
        p, r, d_p, d_r = model.linearised(state, part)
        for weight, residual, derivative in zip(weights, (p, r), (d_p, d_r), strict=True):
            on = weight[part] > 0.0
            d, e = derivative[on], residual[on]
            weighted = d * weight[part][on][:, None, None]
            matrix += weighted.reshape(-1, k).T @ d.reshape(-1, k)
            gradient += np.einsum("nck,nc->k", weighted, e)
    return Normal(_inverse(matrix, model.names), gradient)


def binned(model: Model, state: State) -> tuple[Binned, Binned]:
    """Translation and rotation at a state, in bins."""
    weights = [_weights(residual) for residual in model.residuals(state)]
    bins = _bins(model)
    count, k = int(bins[-1]) + 1, len(model.names)
    sums = [np.zeros((count, 1 + 3 + 3 * k)) for _ in weights]
    for part in model.chunks():
        p, r, d_p, d_r = model.linearised(state, part)
        starts = np.flatnonzero(np.diff(bins[part], prepend=-1))
        for total, weight, e, d in zip(sums, weights, (p, r), (d_p, d_r), strict=True):
            w = weight[part, None]
            columns = np.concatenate((np.ones_like(w), e, d.reshape(len(e), -1)), axis=1)
            columns = np.where(w > 0.0, w * columns, 0.0)
            total[bins[part][starts]] += np.add.reduceat(columns, starts, axis=0)
    found = []
    for total in sums:
        weight = total[:, 0]
        known = weight > LEAST_WEIGHT * np.median(weight[weight > 0.0])
        mean = np.where(known[:, None], total / np.where(known, weight, 1.0)[:, None], 0.0)
        found.append(Binned(mean[:, 1:4], mean[:, 4:].reshape(-1, 3, k), known))
    return found[0], found[1]


def following(model: Model, state: State) -> tuple[Floats, Floats]:
    """What errors that follow the motion are like, (b, 3, 2) of translation, (b, 3, 1) of rotation:
    the means in bins of `Model.following`.
    """
    bins = _bins(model)
    starts = np.flatnonzero(np.diff(bins, prepend=-1))
    found = []
    for columns in model.following(state):
        mean = np.zeros((int(bins[-1]) + 1, *columns.shape[1:]))
        held = np.where(np.isfinite(columns), columns, 0.0)
        mean[bins[starts]] = np.add.reduceat(held, starts, axis=0)
        mean /= np.maximum(np.bincount(bins), 1)[:, None, None]
        found.append(mean)
    return found[0], found[1]


def _bins(model: Model) -> Ints:
    """The bin (n,) of each sample, from the first on."""
    bins: Ints = ((model.since_middle - model.since_middle[0]) / BIN_S).astype(np.int64)
    return bins


def general_equations(
    translation: Binned,
    rotation: Binned,
    noises: tuple[Noise, Noise],
    names: tuple[str, ...],
    hats: Hats | None,
    information: Floats,
    pull: Floats,
) -> tuple[Normal, Floats]:
    """The equations in bins under the noise that both kinds show, and the covariance (k, k).

    Rotation is whitened. Translation isn't: on recordings its error is not one noise at all times
    but moves with the motion (the headset's scale alone differs by 1 % from one minute to the
    next), and whitening, which takes for exact what is quick, made X worse there. It is fitted
    with equal weights, freed of slow drift, and as a whole is worth what its noise lets it be; the
    covariance is that of this estimate under the noise, not that of the best one.

    Args:
        translation: residuals and derivatives.
        rotation: the same.
        noises: of both.
        names: of the parameters.
        hats: functions of time (b, h) that a drift of the world is made of, or None.
        information: as in `normal_equations`.
        pull: as in `normal_equations`.
    """
    k = len(names)
    rows = noises[1].rows(rotation.known)
    d = noises[1].whitened(rotation.derivative, rows).reshape(-1, k)
    e = noises[1].whitened(rotation.residual, rows).reshape(-1)
    matrix, gradient = information + d.T @ d, pull + d.T @ e
    middle = matrix.copy()
    known = translation.known
    kept = np.where(known[:, None, None], translation.derivative, 0.0)
    if hats is not None:
        kept = _without_drift(kept, hats, known)
    flat = kept.reshape(-1, k)
    equal = flat.T @ translation.derivative.reshape(-1, k)
    scatter = noises[0].scattered(kept)
    felt = np.diag(equal) > 1e-9 * np.trace(equal)
    variance = float(np.mean(np.diag(scatter)[felt] / np.diag(equal)[felt]))
    matrix += equal / variance
    gradient += flat.T @ translation.residual.reshape(-1) / variance
    middle += scatter / variance**2
    bread = _inverse(matrix, names)
    return Normal(bread, gradient), bread @ middle @ bread


def drift_hats(bins: int, drift_s: float) -> Hats | None:
    """Piecewise-linear functions of time (bins, h), knots half of `drift_s` apart; sparse.

    None for takes too short to tell drift from motion.
    """
    duration_s = bins * BIN_S
    if duration_s < 2.0 * drift_s:
        return None
    from scipy.sparse import csr_array

    knots = int(np.ceil(2.0 * duration_s / drift_s)) + 1
    at = np.arange(bins) * ((knots - 1.0) / (bins - 1.0))
    left = np.minimum(at.astype(np.int64), knots - 2)
    values = np.stack((left + 1.0 - at, at - left), axis=1)
    columns = np.stack((left, left + 1), axis=1)
    starts = 2 * np.arange(bins + 1)
    return csr_array((values.ravel(), columns.ravel(), starts), shape=(bins, knots))


def _without_drift(values: Floats, hats: Hats, known: Bools) -> Floats:
    """Values (b, 3, k) less what a drift of hats (b, h) explains, up to `DRIFT_SHARE` of it."""
    held = hats.multiply(known[:, None]).tocsr()
    inner = (held.T @ held).toarray()
    size = inner.shape[0]
    ridge = DRIFT_SHARE / (1.0 - DRIFT_SHARE) * np.trace(inner) / size
    flat = values.reshape(len(values), -1)
    slow = np.linalg.solve(inner + ridge * np.eye(size), held.T @ flat)
    found: Floats = flat - held @ slow
    return found.reshape(values.shape)


def _weights(residual: Floats) -> Floats:
    """Weights (n,) of residuals (n, 3) by Tukey's loss, in units of 1 / variance."""
    lengths = np.linalg.norm(residual, axis=1)
    known = np.isfinite(lengths)
    if not known.any():
        raise EstimationError("the fit left the reference's time", fix="check the clock")
    weights = np.zeros(len(lengths))
    weights[known] = bisquare(lengths[known], CUT) / scale_of(lengths[known]) ** 2
    return weights


def _inverse(matrix: Floats, names: tuple[str, ...]) -> Floats:
    """The inverse of the normal matrix (k, k).

    Raises:
        EstimationError: it is singular; the message names the parameter left open.
    """
    diagonal = np.diag(matrix)
    if np.all(diagonal > 0.0):
        root = 1.0 / np.sqrt(diagonal)
        values, vectors = np.linalg.eigh(matrix * np.outer(root, root))
        if values[0] > 1e-10:
            inverse: Floats = (vectors / values) @ vectors.T * np.outer(root, root)
            return inverse
        open_name = names[int(np.argmax(np.abs(vectors[:, 0])))]
    else:
        open_name = names[int(np.argmin(diagonal))]
    raise EstimationError(
        f"the motion leaves {open_name} open", fix="more motion, or fewer free parameters"
    )
