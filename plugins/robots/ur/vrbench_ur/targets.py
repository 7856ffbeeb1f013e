"""Where the flange must be so that the eye moves as the head did, and the postures for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vrbench.errors import ConfigError
from vrbench.geometry import (
    Bools,
    Floats,
    Transform,
    quat_multiply,
    quat_rotate,
    rotvec_to_quat,
)
from vrbench.trajectory import Trajectory
from vrbench_ur.arms import POSITION, Dh
from vrbench_ur.inverse import BRANCHES, solve
from vrbench_ur.options import Options, Start

# A base whose z is up, seen from an eye whose y is up.
UPRIGHT = rotvec_to_quat(np.array([np.pi / 2, 0.0, 0.0]))


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """A motion to be replayed.

    Attributes:
        motion: `T_eye0_eye`, stamps from 0.
        mounting: `T_tcp_eye`, nominal.
        options: of the arm.
    """

    motion: Trajectory
    mounting: Transform
    options: Options

    @property
    def rate_hz(self) -> float:
        """Samples a second of the motion."""
        return 1.0 / self.motion.period_s

    def times(self) -> Floats:
        """Of the motion's samples, stretched (n,) [s]."""
        return self.motion.seconds(0) * self.options.stretch

    def coarse(self, rate_hz: float) -> Task:
        """The same with fewer samples, at about the rate."""
        step = max(1, round(self.rate_hz / rate_hz))
        return Task(self.motion[::step], self.mounting, self.options)

    def tcp(self, start: Start) -> Transform:
        """`T_base_tcp` (n,): the paper's `T_i = B A dO_i A^-1`, A the mounting."""
        return start_eye(start) @ self.motion.pose @ self.mounting.inverse()

    def flange(self, start: Start) -> Transform:
        """`T_base_flange` (n,)."""
        return self.tcp(start) @ self.options.flange_tcp.inverse()

    def flanges(self, p: Floats, yaw: Floats) -> Transform:
        """`T_base_flange` (k, n) of many starts: positions (k, 3) [m] and yaws (k,) [rad]."""
        last = self.motion.pose @ self.mounting.inverse() @ self.options.flange_tcp.inverse()
        eye = Transform(p[:, None], quat_multiply(_yaw(yaw), UPRIGHT)[:, None])
        return eye @ Transform(last.p[None], last.q[None])


def _yaw(angle: Floats) -> Floats:
    """Turns about base z, quaternions (..., 4)."""
    zero = np.zeros_like(angle)
    return np.stack((zero, zero, np.sin(angle / 2), np.cos(angle / 2)), axis=-1)


def start_eye(start: Start) -> Transform:
    """`T_base_eye0`: upright, so that gravity stays where the headset's IMU expects it."""
    yaw = np.asarray(np.radians(start.yaw_deg))
    return Transform(np.array(start.p_m), quat_multiply(_yaw(yaw), UPRIGHT))


def check_motion(motion: Trajectory) -> None:
    """Refuses what no arm can replay.

    Raises:
        ConfigError: fewer than 12 samples, values not finite, no unit quaternions, a gap.
    """
    if len(motion) < 12:
        raise ConfigError(f"the motion has {len(motion)} samples", field="motion", fix="12 or more")
    values = np.column_stack((motion.pose.p, motion.pose.q))
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(bad):
        at = motion.t[bad[0]] / 1e9
        raise ConfigError(f"the motion is not finite at {at:.3f} s", field="motion")
    length = np.abs(np.linalg.norm(motion.pose.q, axis=1) - 1.0)
    if length.max() > 1e-6:
        k = int(np.argmax(length))
        raise ConfigError(
            f"the quaternion at {motion.t[k] / 1e9:.3f} s is no unit quaternion", field="motion"
        )
    if motion.t[0] != 0:
        raise ConfigError("the motion's stamps do not start at 0", field="motion")
    gap = np.diff(motion.t)
    if gap.max() > 0.5e9:
        k = int(np.argmax(gap))
        raise ConfigError(
            f"the motion has a gap of {gap[k] / 1e9:.2f} s at {motion.t[k] / 1e9:.2f} s",
            field="motion",
            fix="a robot can't be told what to do in it: fill it or cut the motion there",
        )


def postures(flange: Transform, dh: Dh) -> Floats:
    """Joint angles (8, n, 6) [rad] along poses (n,), continuous in each branch; NaN beyond reach.

    Whole turns are chosen so that each joint stays as near to zero as it can.
    """
    q = np.moveaxis(solve(flange, dh), -2, 0)
    for branch in range(BRANCHES):
        q[branch] = _unwound(q[branch])
    return q


def _unwound(q: Floats) -> Floats:
    """Angles (n, 6) without leaps of a whole turn, up to the first NaN."""
    bad = np.flatnonzero(np.isnan(q[:, 0]))
    end = bad[0] if len(bad) else len(q)
    if end == 0:
        return q
    part = np.unwrap(q[:end], axis=0)
    middle = (part.max(axis=0) + part.min(axis=0)) / 2
    turns = np.where(np.pi + 1e-9 < POSITION, np.round(middle / (2 * np.pi)), 0.0)
    q[:end] = part - 2 * np.pi * turns
    q[end:] = np.nan
    return q


def beside_base(flange: Transform, dh: Dh) -> Floats:
    """How far the wrist's centre stays clear of the column it can't enter (...) [m]."""
    ahead = np.broadcast_to(np.array([0.0, 0.0, dh.d[5]]), flange.p.shape)
    centre = flange.p - quat_rotate(flange.q, ahead)
    clear: Floats = np.hypot(centre[..., 0], centre[..., 1]) - dh.d[3]
    return clear


def reached(q: Floats) -> Bools:
    """Which postures (..., n) of angles (..., n, 6) are there."""
    there: Bools = ~np.isnan(q[..., 0])
    return there
