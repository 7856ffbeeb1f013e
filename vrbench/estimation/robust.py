"""Weights of robust regression, with the scale taken from the data."""

from __future__ import annotations

import numpy as np

from vrbench.geometry import Floats

# The median length of a normal vector with three components of unit variance.
MEDIAN_LENGTH_3 = 1.5382
# Residuals that agree to rounding have no scale; a thousandth of a nanometre [m] or radian.
SMALLEST_SCALE = 1e-12


def scale_of(lengths: Floats) -> float:
    """The standard deviation of a component, from lengths (n,) of residuals with three."""
    return max(float(np.median(lengths)) / MEDIAN_LENGTH_3, SMALLEST_SCALE)


def soft_l1(lengths: Floats) -> Floats:
    """Weights (n,) of the sum of lengths: convex, finds the way past outliers from any start."""
    return 1.0 / np.maximum(lengths / scale_of(lengths), 0.1)


def bisquare(lengths: Floats, cut: float = 7.0) -> Floats:
    """Tukey's weights (n,): zero beyond `cut` standard deviations."""
    u = lengths / (cut * scale_of(lengths))
    return np.where(u < 1.0, (1.0 - u**2) ** 2, 0.0)
