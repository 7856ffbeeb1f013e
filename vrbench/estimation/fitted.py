"""What a fit found: parameters, their covariance, and what is left over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vrbench.clocks import ClockMap
from vrbench.estimation.model import Model, State
from vrbench.geometry import (
    Floats,
    Ints,
    Transform,
    quat_rotate,
)
from vrbench.trajectory import NS, Trajectory


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """The result of `fit`; what was not free is what was given.

    Attributes:
        clock: from the estimate's clock to the reference's.
        x: `T_tcp_eye`.
        y: `T_base_world`, right about the mean eye position whether or not the scale is applied.
        scale: factor on the eye's positions about `scale_centre` that fits the reference; ref/est.
        scale_centre: the mean eye position (3,) [m], in `world`.
        names: the free parameters (k,): `offset` [s] and `skew` [s/s] at the middle of the
            samples, `x.rx` .. (rotation vector [rad] in `eye`), `x.px` .. ([m] in `tcp`),
            `y.rx` .. ([rad] in `base`), `y.px` .. ([m] in `base`), `scale`.
        covariance: of those (k, k), under the noise that the residuals show.
        t: stamps of the samples used (n,) [ns], on the estimate's clock.
        translation: residuals (n, 3) [m] at the eye in `base`: estimate minus reference.
        rotation: residuals (n, 3) [rad], rotation vectors in `eye`.
    """

    clock: ClockMap
    x: Transform
    y: Transform
    scale: float
    scale_centre: Floats
    names: tuple[str, ...]
    covariance: Floats
    t: Ints
    translation: Floats
    rotation: Floats

    def sigma(self, name: str) -> float:
        """The standard deviation of one free parameter."""
        index = self.names.index(name)
        return float(np.sqrt(self.covariance[index, index]))


def fitted(
    model: Model,
    clock: ClockMap,
    state: State,
    covariance: Floats,
    used: Trajectory,
) -> Fit:
    """The result of a fit of a model to the poses used, from where it ended."""
    translation, rotation = model.residuals(state)
    lever = quat_rotate(state.y_q, model.mean_p)
    to_y = np.eye(len(model.names))
    if "y.rx" in model.names:
        # inside, Y turns about the mean eye position; y.p is the place of the world's origin:
        # dp = dc - a x (R_y p_mean)
        i = model.names.index("y.rx")
        to_y[i + 3 : i + 6, i : i + 3] = _cross(lever)
    return Fit(
        clock=_corrected(clock, state, model.middle_ns),
        x=state.x,
        y=Transform(state.centre - lever, state.y_q),
        scale=state.scale,
        scale_centre=model.mean_p,
        names=model.names,
        covariance=to_y @ covariance @ to_y.T,
        t=used.t,
        translation=translation,
        rotation=rotation,
    )


def _corrected(clock: ClockMap, state: State, middle_ns: int) -> ClockMap:
    """The initial clock with its offset and slope corrected."""
    knots = clock.knots
    if len(knots) == 1:
        return ClockMap.affine(
            middle_ns, float(clock.offset_ns(middle_ns)) / NS + state.offset, state.skew
        )
    offsets = clock.offset_ns(knots) + state.offset * NS + state.skew * (knots - middle_ns)
    return ClockMap(knots, offsets)


def _cross(v: Floats) -> Floats:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
