"""What a fit found: parameters, their covariance, and what is left over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vrbench.clocks import ClockMap
from vrbench.geometry import (
    Floats,
    Ints,
    Transform,
)


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
