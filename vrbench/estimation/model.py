"""The one equation as residuals with derivatives: `T_base_tcp(t) X = Y T_world_eye(t')`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from vrbench.clocks import ClockMap
from vrbench.estimation.interpolation import PoseSpline
from vrbench.geometry import (
    Floats,
    Ints,
    Transform,
    cross,
    quat_conjugate,
    quat_multiply,
    quat_normalize,
    quat_rotate,
    quat_to_matrix,
    quat_to_rotvec,
    rotvec_to_quat,
)
from vrbench.trajectory import NS, Trajectory

PARAMETERS = {
    "offset": ("offset",),
    "skew": ("skew",),
    "x": ("x.rx", "x.ry", "x.rz", "x.px", "x.py", "x.pz"),
    "y": ("y.rx", "y.ry", "y.rz", "y.px", "y.py", "y.pz"),
    "scale": ("scale",),
}
CHUNK = 1 << 12


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Where a fit stands.

    Attributes:
        offset: correction of the initial clock's offset at the middle of the samples [s].
        skew: correction of its slope [s/s].
        x: `T_tcp_eye`.
        y_q: rotation (4,) of `T_base_world`.
        centre: where the mean eye position lies in `base` (3,) [m].
        scale: of the eye's positions about their mean.
    """

    offset: float
    skew: float
    x: Transform
    y_q: Floats
    centre: Floats
    scale: float

    def moved(self, names: tuple[str, ...], step: Floats) -> State:
        """The state after a step (k,) in the parameters `names`, on the manifold."""
        d = dict(zip(names, step.tolist(), strict=True))
        new = replace(
            self,
            offset=self.offset + d.get("offset", 0.0),
            skew=self.skew + d.get("skew", 0.0),
            scale=self.scale + d.get("scale", 0.0),
        )
        if "x.rx" in d:
            turn = rotvec_to_quat(np.array([d["x.rx"], d["x.ry"], d["x.rz"]]))
            p = self.x.p + np.array([d["x.px"], d["x.py"], d["x.pz"]])
            new = replace(new, x=Transform(p, quat_normalize(quat_multiply(self.x.q, turn))))
        if "y.rx" in d:
            turn = rotvec_to_quat(np.array([d["y.rx"], d["y.ry"], d["y.rz"]]))
            new = replace(
                new,
                y_q=quat_normalize(quat_multiply(turn, self.y_q)),
                centre=self.centre + np.array([d["y.px"], d["y.py"], d["y.pz"]]),
            )
        return new


class Model:
    """Residuals of `T_base_tcp(t) X = Y T_world_eye(t')` at the eye's samples.

    Translation (m, 3) [m], in `base` and at the eye: Y p_eye minus the eye's place on the tcp.
    Rotation (m, 3) [rad]: the rotation vector of (R_tcp R_x)^-1 R_y R_eye. At the eye, a headset's
    errors of position and of rotation stay apart.

    Args:
        spline: the reference.
        clock: the initial clock, of which `State` holds corrections.
        estimate: the eye's poses, all of which the reference covers.
        names: the free parameters, in the order of the derivatives' columns.
    """

    def __init__(
        self, spline: PoseSpline, clock: ClockMap, estimate: Trajectory, names: tuple[str, ...]
    ) -> None:
        self.names = names
        self._spline = spline
        self._q = estimate.pose.q
        self.middle_ns = int(estimate.t[0] + (estimate.t[-1] - estimate.t[0]) // 2)
        self.since_middle = estimate.seconds(self.middle_ns)
        self._s = _reference_seconds(estimate.t, clock, spline.origin_ns)
        self.mean_p = estimate.pose.p.mean(axis=0)
        self._centred = estimate.pose.p - self.mean_p
        # residuals, derivatives and what follows the motion are asked for at one state in turn
        self._state: State | None = None
        self._found: dict[tuple[int, int], _Terms] = {}

    def __len__(self) -> int:
        return len(self._s)

    def chunks(self) -> Iterator[slice]:
        """Parts of the samples whose derivatives fit into memory."""
        for start in range(0, len(self), CHUNK):
            yield slice(start, min(start + CHUNK, len(self)))

    def residuals(self, state: State) -> tuple[Floats, Floats]:
        """Translation and rotation residuals (n, 3) of all samples; NaN off the reference."""
        parts = [self._terms(state, part) for part in self.chunks()]
        return (
            np.concatenate([terms.translation for terms in parts]),
            np.concatenate([terms.rotation for terms in parts]),
        )

    def following(self, state: State) -> tuple[Floats, Floats]:
        """What errors that follow the motion are like, for factors of any size.

        Returns:
            (n, 3, 2) of translation: the way from the mean position [m], as a wrong scale errs, and
            the acceleration [m/s^2], as a prediction errs that knows none; (n, 3, 1) of rotation:
            the angular acceleration [rad/s^2]. NaN off the reference.
        """
        parts = [self._terms(state, part) for part in self.chunks()]
        way = np.concatenate([terms.unscaled for terms in parts])
        velocity = np.concatenate([terms.velocity for terms in parts])
        turning = np.concatenate([terms.angular_velocity for terms in parts])
        turning = turning @ quat_to_matrix(state.x.q)
        return (
            np.stack((way, np.gradient(velocity, self.since_middle, axis=0)), axis=2),
            np.gradient(turning, self.since_middle, axis=0)[:, :, None],
        )

    def linearised(self, state: State, part: slice) -> tuple[Floats, Floats, Floats, Floats]:
        """Residuals (m, 3), (m, 3) of a part and their derivatives (m, 3, k), (m, 3, k)."""
        terms = self._terms(state, part)
        shape = len(terms.translation), 3, len(self.names)
        place, turn = np.zeros(shape), np.zeros(shape)
        at = {name: i for i, name in enumerate(self.names)}
        tcp, mount = quat_to_matrix(terms.tcp_q), quat_to_matrix(state.x.q)
        left = _inverse_left_jacobian(terms.rotation)
        since = self.since_middle[part, None]
        if not at.keys().isdisjoint(("offset", "skew")):
            turn_rate = np.einsum("nij,nj->ni", left, terms.angular_velocity @ mount)
        if "offset" in at:
            place[:, :, at["offset"]] = terms.velocity
            turn[:, :, at["offset"]] = turn_rate
        if "skew" in at:
            place[:, :, at["skew"]] = terms.velocity * since
            turn[:, :, at["skew"]] = turn_rate * since
        if "x.rx" in at:
            first = at["x.rx"]
            place[:, :, first + 3 : first + 6] = -tcp
            turn[:, :, first : first + 3] = -left
        if "y.rx" in at:
            first = at["y.rx"]
            place[:, :, first : first + 3] = -state.scale * _cross_matrices(terms.unscaled)
            place[:, :, first + 3 : first + 6] = np.eye(3)
            turn[:, :, first : first + 3] = left @ np.swapaxes(tcp @ mount, 1, 2)
        if "scale" in at:
            place[:, :, at["scale"]] = terms.unscaled
        return terms.translation, terms.rotation, place, turn

    def _terms(self, state: State, part: slice) -> _Terms:
        """Those of the last state are kept."""
        if self._state is not state:
            self._state, self._found = state, {}
        of = part.start, part.stop
        if of not in self._found:
            self._found[of] = self._computed(state, part)
        return self._found[of]

    def _computed(self, state: State, part: slice) -> _Terms:
        s = self._s[part] - state.offset - state.skew * self.since_middle[part]
        tcp = self._spline.motion(s)
        unscaled = quat_rotate(state.y_q, self._centred[part])
        place = tcp.p + quat_rotate(tcp.q, state.x.p)
        measured = quat_multiply(state.y_q, self._q[part])
        relative = quat_multiply(quat_conjugate(quat_multiply(tcp.q, state.x.q)), measured)
        return _Terms(
            translation=state.scale * unscaled + state.centre - place,
            rotation=quat_to_rotvec(relative),
            velocity=tcp.v + quat_rotate(tcp.q, cross(tcp.w, state.x.p)),
            angular_velocity=tcp.w,
            tcp_q=tcp.q,
            unscaled=unscaled,
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Terms:
    translation: Floats
    rotation: Floats
    velocity: Floats
    angular_velocity: Floats
    tcp_q: Floats
    unscaled: Floats


def _reference_seconds(t: Ints, clock: ClockMap, origin_ns: int) -> Floats:
    """Times on the reference's clock [s], not rounded to nanoseconds."""
    return (t - np.int64(origin_ns) - clock.offset_ns(t)) / NS


def _cross_matrices(v: Floats) -> Floats:
    """Matrices (m, 3, 3) with M u = v x u."""
    m = np.zeros((len(v), 3, 3))
    m[:, 0, 1], m[:, 0, 2], m[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    m[:, 1, 0], m[:, 2, 0], m[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return m


def _inverse_left_jacobian(r: Floats) -> Floats:
    """Matrices d log(exp(e) exp(r)) / de (m, 3, 3), to second order in r (m, 3) [rad]."""
    cross = _cross_matrices(r)
    inverse: Floats = np.eye(3) - 0.5 * cross + cross @ cross / 12.0
    return inverse
