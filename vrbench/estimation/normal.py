"""Normal equations of the model: of samples taken as independent, and whitened in bins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vrbench.errors import EstimationError
from vrbench.estimation.model import Model, State
from vrbench.estimation.noise import BIN_S, LEAST_WEIGHT, Noise, estimate_noise
from vrbench.estimation.robust import bisquare, scale_of
from vrbench.geometry import Bools, Floats

# Wide, so that the heavy tails of real tracking count almost in full, yet jumps not at all: under
# a scale that is free, even a little weight of a jump shrinks it.
CUT = 15.0


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
    bins = ((model.since_middle - model.since_middle[0]) / BIN_S).astype(np.int64)
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


def whitened_equations(
    parts: tuple[Binned, Binned],
    noises: tuple[Noise, Noise],
    names: tuple[str, ...],
    information: Floats,
    pull: Floats,
) -> tuple[Normal, Floats]:
    """The equations in bins under the given noises, and the scores (c, k), for the covariance.

    Args:
        parts: translation and rotation.
        noises: of each.
        names: of the parameters.
        information: as in `normal_equations`.
        pull: as in `normal_equations`.
    """
    k = len(names)
    matrix, gradient = information.copy(), pull.copy()
    scores = np.zeros((len(parts[0].known), k))
    for part, noise in zip(parts, noises, strict=True):
        rows = noise.rows(part.known)
        d = noise.whitened(part.derivative, rows)
        e = noise.whitened(part.residual, rows)
        matrix += d.reshape(-1, k).T @ d.reshape(-1, k)
        each = np.einsum("nck,nc->nk", d, e)
        gradient += each.sum(axis=0)
        scores[rows] += each
    return Normal(_inverse(matrix, names), gradient), scores


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
