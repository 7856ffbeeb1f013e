"""Weighted normal equations of the model, with or without a slow drift of the world's frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vrbench.errors import EstimationError
from vrbench.estimation.model import Model, State
from vrbench.estimation.robust import bisquare, scale_of
from vrbench.geometry import Floats

# Wide, so that the heavy tails of real tracking count almost in full, yet jumps not at all: under
# a scale that is free, even a little weight of a jump shrinks it.
CUT = 15.0
BIN_S = 0.1
# How much of a slow residual stays with the parameters when drift is allowed.
DRIFT_SHARE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Normal:
    """The normal equations at a state.

    Attributes:
        bread: inverse of the weighted normal matrix (k, k).
        gradient: half the gradient of the cost (k,).
        translation: residuals (n, 3) [m].
        rotation: residuals (n, 3) [rad].
    """

    bread: Floats
    gradient: Floats
    translation: Floats
    rotation: Floats
    _pairs: tuple[_Kind, _Kind]
    _hats: Floats | None

    def scores(self, model: Model, state: State) -> Floats:
        """The gradient's parts (b, k) by bins of `BIN_S`, for `block_covariance`."""
        bins = ((model.since_middle - model.since_middle[0]) / BIN_S).astype(np.int64)
        scores = np.zeros((int(bins[-1]) + 1, len(model.names)))
        for part in model.chunks():
            p, r, d_p, d_r = model.linearised(state, part)
            for kind, residual, d in zip(self._pairs, (p, r), (d_p, d_r), strict=True):
                weight = kind.weight[part]
                if self._hats is not None:
                    d = d - np.einsum("nh,chk->nck", self._hats[part], kind.slow)
                each = np.einsum("nck,nc->nk", d, np.nan_to_num(residual) * weight[:, None])
                np.add.at(scores, bins[part], np.where(weight[:, None] > 0.0, each, 0.0))
        return scores


@dataclass(frozen=True, slots=True, eq=False)
class _Kind:
    """Translation or rotation: weights (n,), slow part of the derivatives (3, h, k)."""

    weight: Floats
    slow: Floats


def drift_hats(model: Model, drift_s: float | None) -> Floats | None:
    """Piecewise-linear functions of time (n, h), knots half of `drift_s` apart.

    None if no drift is wanted, or if the take is too short to tell drift from motion.
    """
    first, last = model.since_middle[0], model.since_middle[-1]
    if drift_s is None or last - first < 2.0 * drift_s:
        return None
    knots = np.linspace(first, last, int(np.ceil((last - first) / (0.5 * drift_s))) + 1)
    return np.stack([np.interp(model.since_middle, knots, hat) for hat in np.eye(len(knots))], 1)


def normal_equations(
    model: Model, state: State, hats: Floats | None, information: Floats, pull: Floats
) -> Normal:
    """The equations at a state.

    With `hats` (n, h) the world's frame drifts by small piecewise-linear amounts, which are
    eliminated: a mixed model, in which `DRIFT_SHARE` sets the drift's variance.

    Args:
        information: of a Gaussian prior on the parameters (k, k).
        pull: the prior's part of the gradient (k,).
    """
    translation, rotation = model.residuals(state)
    weights = (_weights(translation), _weights(rotation))
    k, h = len(model.names), 0 if hats is None else hats.shape[1]
    matrix, gradient = information.copy(), pull.copy()
    inner = np.zeros((2, h, h))
    mixed, slow_residual = np.zeros((2, 3, h, k)), np.zeros((2, 3, h))
    for part in model.chunks():
        p, r, d_p, d_r = model.linearised(state, part)
        for i, (residual, derivative) in enumerate(((p, d_p), (r, d_r))):
            on = weights[i][part] > 0.0
            weight, d, e = weights[i][part][on], derivative[on], residual[on]
            weighted = d * weight[:, None, None]
            matrix += weighted.reshape(-1, k).T @ d.reshape(-1, k)
            gradient += np.einsum("nck,nc->k", weighted, e)
            if hats is not None:
                b = hats[part][on]
                inner[i] += (b * weight[:, None]).T @ b
                mixed[i] += np.stack([b.T @ weighted[:, c] for c in range(3)])
                slow_residual[i] += (e * weight[:, None]).T @ b
    kinds = []
    for i in range(2):
        slow = np.zeros((3, h, k))
        if hats is not None:
            ridge = DRIFT_SHARE / (1.0 - DRIFT_SHARE) * np.trace(inner[i]) / h
            slow = np.linalg.solve(inner[i] + ridge * np.eye(h), mixed[i])
            matrix -= np.einsum("chk,chl->kl", mixed[i], slow)
            gradient -= np.einsum("chk,ch->k", slow, slow_residual[i])
        kinds.append(_Kind(weights[i], slow))
    bread = _inverse(matrix, model.names)
    return Normal(bread, gradient, translation, rotation, (kinds[0], kinds[1]), hats)


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
