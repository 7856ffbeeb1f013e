"""The emulated arm: where its joints are, tick by tick, as a controller would move them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from random import Random

from vrbench_ur.arms import Arm
from vrbench_ur.kinematics import flange_once

TICK_S = 0.002
SIX = range(6)
# Joints behind their targets [s]; noise of the encoders [rad]: some 5 um at the TCP.
JOINT_LAG_S = 0.004
NOISE_RAD = 4e-6
# Slow wander while moving: 0.03 mm at the TCP between repeats.
WANDER_RAD, WANDER_S = 3e-5, 1.0
HOME = (0.0, -math.pi / 2, math.pi / 2, -math.pi / 2, -math.pi / 2, 0.0)

# A target: given seconds since it began, joints (6) and whether it has ended.
Course = Callable[[float], tuple[list[float], bool]]


class Twin:
    """Six joints that follow what they are told.

    Attributes:
        q: targets of the controller (6) [rad]; qd: their speeds [rad/s].
        actual: where the encoders say the joints are (6) [rad]; actual_qd: their speeds.
        scaling: speed slider and what slows it, 0..1.
        stuck: whether something holds it.
        tool: `T_flange_tcp`: rotation (3 x 3), position (3) [m].
    """

    def __init__(self, arm: Arm, seed: int, start: Sequence[float] = HOME) -> None:
        self.arm = arm
        self.q, self.qd = list(start), [0.0] * 6
        self.actual, self.actual_qd = list(start), [0.0] * 6
        self.scaling = 1.0
        self.stuck = False
        self.tool: tuple[list[list[float]], list[float]] = (
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            [0.0, 0.0, 0.0],
        )
        self._rng = Random(seed)
        self._wander = [0.0] * 6
        self._course: Course | None = None
        self._since = 0.0
        self._servo: tuple[list[float], float] | None = None
        self._braking = 0.0

    @property
    def busy(self) -> bool:
        """Whether a move with an end of its own goes on."""
        return self._course is not None or self._braking > 0

    @property
    def moving(self) -> bool:
        return max(abs(x) for x in self.qd) > 1e-4

    def move(self, goal: Sequence[float], speed: float, acceleration: float) -> None:
        """moveJ: all joints arrive together, the farthest by a trapezoid of speed."""
        self._begin(trapezoid(list(self.q), list(goal), speed, acceleration))

    def follow(self, points: Sequence[tuple[Sequence[float], float, float]]) -> None:
        """A path: joints, speed and acceleration of each waypoint; stops at none but the last."""
        courses, ends, at = [], [], list(self.q)
        total = 0.0
        for goal, speed, acceleration in points:
            duration = max(abs(g - a) for g, a in zip(goal, at, strict=True)) / speed
            courses.append((total, max(duration, 1e-6), at, list(goal)))
            total += max(duration, 1e-6)
            ends.append(acceleration)
            at = list(goal)

        def course(t: float) -> tuple[list[float], bool]:
            begin, duration, a, b = next((c for c in reversed(courses) if c[0] <= t), courses[0])
            u = min(max((t - begin) / duration, 0.0), 1.0)
            return [x + u * (y - x) for x, y in zip(a, b, strict=True)], t >= total

        self._begin(course)

    def servo(self, goal: Sequence[float], lookahead: float) -> None:
        """servoJ: follows the goal, `lookahead` behind a steady motion."""
        self._course, self._braking = None, 0.0
        self._servo = (list(goal), 2.0 / max(lookahead, 0.01))

    def stop(self, deceleration: float) -> None:
        """Brakes all joints [rad/s2]; they ring down a little, as brakes do."""
        self._course = self._servo = None
        self._braking = max(deceleration, 0.1) if self.moving else 0.0
        if not self._braking:
            self.qd = [0.0] * 6

    def _begin(self, course: Course) -> None:
        self._servo, self._braking = None, 0.0
        self._course, self._since = course, 0.0

    def tick(self) -> None:
        """Two milliseconds go by."""
        before = self.q
        if self.stuck:
            self.qd = [0.0] * 6
        elif self._course is not None:
            self._since += TICK_S * self.scaling
            self.q, over = self._course(self._since)
            if over:
                self._course = None
            self.qd = [(x - y) / TICK_S for x, y in zip(self.q, before, strict=True)]
        elif self._servo is not None:
            self._follow_servo(*self._servo)
        elif self._braking:
            self._brake()
        else:
            self.qd = [0.0] * 6
        self._sense()

    def _follow_servo(self, goal: list[float], w: float) -> None:
        """The exact step of a critically damped follower towards a goal that stands still."""
        t = TICK_S * self.scaling
        fall = math.exp(-w * t)
        q, qd = [], []
        for x, v, g, top in zip(self.q, self.qd, goal, self.arm.speed, strict=True):
            off = x - g
            slope = v + w * off
            new = g + (off + slope * t) * fall
            # a joint goes no faster than it can
            most = 1.05 * float(top) * TICK_S
            new = min(max(new, x - most), x + most)
            q.append(new)
            qd.append((v - w * slope * t) * fall)
        self.q, self.qd = q, qd

    def _brake(self) -> None:
        fastest = max(abs(v) for v in self.qd)
        left = fastest - self._braking * TICK_S
        if left <= 0.0:
            self.qd, self._braking = [0.0] * 6, 0.0
            return
        self.qd = [v * left / fastest for v in self.qd]
        self.q = [x + v * TICK_S for x, v in zip(self.q, self.qd, strict=True)]

    def _sense(self) -> None:
        """The joints behind their targets, with the wander and noise of real ones."""
        gauss, gain = self._rng.gauss, 1.0 - math.exp(-TICK_S / JOINT_LAG_S)
        hold = math.exp(-TICK_S / WANDER_S)
        kick = WANDER_RAD * math.sqrt(1.0 - hold * hold)
        stir = self.moving
        for j in SIX:
            if stir:
                self._wander[j] = hold * self._wander[j] + gauss(0.0, kick)
            v = gain * (self.q[j] + self._wander[j] - self.actual[j])
            self.actual_qd[j] = v / TICK_S
            self.actual[j] += v

    def encoders(self) -> list[float]:
        """Where the encoders say the joints are, noise included (6) [rad]."""
        return [x + self._rng.gauss(0.0, NOISE_RAD) for x in self.actual]

    def tcp(self, q: Sequence[float]) -> list[float]:
        """Position [m] and rotation vector [rad] of the TCP at joints (6)."""
        r, p = flange_once(q, self.arm.dh)
        tr, tp = self.tool
        turned = [[sum(r[i][k] * tr[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
        moved = [p[i] + sum(r[i][k] * tp[k] for k in range(3)) for i in range(3)]
        return moved + rotvec(turned)


def trapezoid(a: list[float], b: list[float], speed: float, acceleration: float) -> Course:
    """From joints a to b (6): up, steady, down."""
    far = max(abs(y - x) for x, y in zip(a, b, strict=True))
    speed = min(speed, math.sqrt(far * acceleration)) if far else speed
    ramp = speed / acceleration
    total = far / speed + ramp if far else 0.0

    def course(t: float) -> tuple[list[float], bool]:
        if t >= total:
            return list(b), True
        if t < ramp:
            s = 0.5 * acceleration * t * t
        elif t > total - ramp:
            s = far - 0.5 * acceleration * (total - t) ** 2
        else:
            s = speed * (t - 0.5 * ramp)
        return [x + (y - x) * s / far for x, y in zip(a, b, strict=True)], False

    return course


def rotvec(r: list[list[float]]) -> list[float]:
    """The rotation vector (3) [rad] of a rotation matrix, by its quaternion."""
    squares = (
        1 + r[0][0] + r[1][1] + r[2][2],
        1 + r[0][0] - r[1][1] - r[2][2],
        1 - r[0][0] + r[1][1] - r[2][2],
        1 - r[0][0] - r[1][1] + r[2][2],
    )
    k = max(range(4), key=lambda i: squares[i])
    xy, xz, yz = r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]
    wx, wy, wz = r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]
    w, x, y, z = (
        (squares[0], wx, wy, wz),
        (wx, squares[1], xy, xz),
        (wy, xy, squares[2], yz),
        (wz, xz, yz, squares[3]),
    )[k]
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    if sine == 0.0:
        return [0.0, 0.0, 0.0]
    angle = 2.0 * math.atan2(sine, w)
    return [angle * x / sine, angle * y / sine, angle * z / sine]


def rotation(v: Sequence[float]) -> list[list[float]]:
    """The rotation matrix of a rotation vector (3) [rad]."""
    angle = math.sqrt(sum(x * x for x in v))
    if angle < 1e-12:
        return [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    x, y, z = (c / angle for c in v)
    c, s = math.cos(angle), math.sin(angle)
    t = 1.0 - c
    return [
        [c + x * x * t, x * y * t - z * s, x * z * t + y * s],
        [y * x * t + z * s, c + y * y * t, y * z * t - x * s],
        [z * x * t - y * s, z * y * t + x * s, c + z * z * t],
    ]
