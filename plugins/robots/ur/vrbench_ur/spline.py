"""Joint paths as quintic B-splines: smooth to the third derivative, evaluated at any rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded

from vrbench.geometry import Floats

DEGREE = 5
# Twelve knots a second on data of 120 Hz: what is faster is noise of the recording, not the head.
KNOT_HZ = 12.0
# A motion that starts or ends faster than this gets a lead of its own [rad/s].
REST = 0.01
LEAD_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class JointPath:
    """Joint angles over time.

    Attributes:
        knots: of the spline (k,) [s], from 0.
        coefficients: (m, 6) [rad].
        lead_in_s, lead_out_s: what was put before and behind the motion so that both ends rest.
    """

    knots: Floats
    coefficients: Floats
    lead_in_s: float = 0.0
    lead_out_s: float = 0.0

    @property
    def duration_s(self) -> float:
        return float(self.knots[-1])

    def at(self, t: Floats, derivative: int = 0) -> Floats:
        """Angles (n, 6) [rad], or a derivative, at times t (n,) [s]; the ends are held."""
        spline = BSpline(self.knots, self.coefficients, DEGREE)
        inside = np.clip(t, 0.0, self.duration_s)
        values: Floats = (spline.derivative(derivative) if derivative else spline)(inside)
        if derivative:
            values[(t < 0.0) | (t > self.duration_s)] = 0.0
        return values

    def grid(self, rate_hz: float) -> Floats:
        """Times (n,) [s] from end to end, evenly spaced at about the rate."""
        return np.linspace(0.0, self.duration_s, max(2, round(self.duration_s * rate_hz) + 1))


def fit(t: Floats, q: Floats) -> JointPath:
    """The least-squares quintic spline through angles q (n, 6) at times t (n,) [s] from 0."""
    rate = (len(t) - 1) / t[-1]
    # the Schoenberg-Whitney condition wants data between knots
    pieces = max(1, round(min(KNOT_HZ, rate / 2.5) * t[-1]))
    inner = np.linspace(0.0, t[-1], pieces + 1)[1:-1]
    knots = np.concatenate((np.zeros(DEGREE + 1), inner, np.full(DEGREE + 1, t[-1])))
    if len(t) <= len(knots) - DEGREE - 1:
        knots = np.concatenate((np.zeros(DEGREE + 1), np.full(DEGREE + 1, t[-1])))
    # scipy's own fit by QR takes seconds where a motion lasts minutes; the normal equations of
    # B-splines are banded, and their condition (some 1e5) leaves ten digits
    values = BSpline.design_matrix(t, knots, DEGREE)
    normal = values.T @ values
    bands = np.zeros((DEGREE + 1, normal.shape[0]))
    for k in range(DEGREE + 1):
        bands[k, : normal.shape[0] - k] = normal.diagonal(k)
    coefficients = solveh_banded(bands, values.T @ q, lower=True)
    return JointPath(knots, np.ascontiguousarray(coefficients))


def smooth(t: Floats, q: Floats) -> JointPath:
    """A path through angles q (n, 6) at times t (n,) [s] that starts and ends at rest.

    Where the motion itself does not, a second of speeding up or slowing down is put before or
    behind it; the motion's own times stay as they are.
    """
    first = fit(t, q)
    ends = np.array([0.0, first.duration_s])
    speed, bend = first.at(ends, 1), first.at(ends, 2)
    step = float(np.median(np.diff(t)))
    lead: Floats = np.arange(round(LEAD_S / step), dtype=np.float64) * step
    length = len(lead) * step
    lead_in = length if np.abs(speed[0]).max() > REST else 0.0
    lead_out = length if np.abs(speed[1]).max() > REST else 0.0
    if not lead_in and not lead_out:
        return first
    if lead_in:
        q = np.concatenate((_ramp(first.at(ends)[0], speed[0], bend[0], lead, length), q))
        t = np.concatenate((lead, t + length))
    if lead_out:
        # the same ramp, backwards in time
        tail = _ramp(first.at(ends)[1], -speed[1], bend[1], lead, length)[::-1]
        q, t = np.concatenate((q, tail)), np.concatenate((t, t[-1] + step + lead))
    whole = fit(t, q)
    return JointPath(whole.knots, whole.coefficients, lead_in, lead_out)


def _ramp(end: Floats, speed: Floats, bend: Floats, t: Floats, length: float) -> Floats:
    """Angles (n, 6) at times t (n,) from rest to `end` with its speed and acceleration (6,)."""
    u = (t / length)[:, None]
    v, a = speed * length, bend * length**2
    # quintic from rest at end - v / 2: coefficients of u^3, u^4, u^5
    rise = 0.5 * v
    c3 = 10 * rise - 4 * v + 0.5 * a
    c4 = -15 * rise + 7 * v - a
    c5 = 6 * rise - 3 * v + 0.5 * a
    return end - rise + c3 * u**3 + c4 * u**4 + c5 * u**5
