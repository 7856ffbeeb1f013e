"""What a joint path must satisfy, checked along the whole of it at the motion's own rate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from vrbench.geometry import Bools, Floats
from vrbench_ur.arms import JOINTS, POSITION, Arm
from vrbench_ur.cell import Cell
from vrbench_ur.kinematics import link_frames
from vrbench_ur.options import Options, box_limits
from vrbench_ur.spline import JointPath


@dataclass(frozen=True, slots=True)
class Breach:
    """The first place where a path breaks one limit.

    Attributes:
        check: which limit, `speed`.
        time_s: where along the path [s]; below 0 for the lead, told on the motion's time.
        where: the joint or the pair of bodies.
        value, limit: in `unit`.
        unit: of both.
    """

    check: str
    time_s: float
    where: str
    value: float
    limit: float
    unit: str

    def earlier(self, seconds: float) -> Breach:
        """The same on a time that begins so much later."""
        return replace(self, time_s=self.time_s - seconds)

    def __str__(self) -> str:
        word = "below" if self.check in LEAST else "above"
        when = (
            f"at {self.time_s:.2f} s"
            if self.time_s >= 0
            else f"{-self.time_s:.2f} s before the motion, while the arm speeds up"
        )
        return (
            f"{self.check} {when}: {self.where}, {self.value:.4g} {self.unit} "
            f"is {word} {self.limit:.4g}"
        )


# Checks whose limit is the least that is allowed.
LEAST = {"clearance", "wrist singularity", "elbow singularity", "shoulder singularity"}


@dataclass(frozen=True, slots=True, eq=False)
class Examined:
    """A path's checks.

    Attributes:
        t: the times that were looked at (n,) [s].
        breaches: the first of each check, by time.
        worst: by check, the worst use of its limit: 1 is the limit itself.
        clearance: least distance of any pair (n,) [m].
        keep_m: the clearance that must be kept [m].
        speed: share of the joint's full speed (n, 6).
        ok_until_s: time of the first breach, the path's duration where there is none [s].
    """

    t: Floats
    breaches: tuple[Breach, ...]
    worst: Mapping[str, float]
    clearance: Floats
    keep_m: float
    speed: Floats
    ok_until_s: float
    nearest: tuple[str, str] = ("", "")
    extra: Mapping[str, float] = field(default_factory=dict)

    @property
    def cost(self) -> float:
        """The worst use of any limit; 1 or less is a path that can be done."""
        return max(self.worst.values())


def singularity(q: Floats, arm: Arm) -> tuple[Floats, Floats, Floats]:
    """Distances from singular postures (n,): wrist and elbow [rad], shoulder [m]."""
    wrist = np.arcsin(np.abs(np.sin(q[:, 4])))
    elbow = np.arcsin(np.abs(np.sin(q[:, 2])))
    # a folded elbow is singular too, but self-collision comes long before
    frames = link_frames(q, arm.dh)
    shoulder = np.hypot(frames[:, 5, 0, 3], frames[:, 5, 1, 3]) - arm.dh.d[3]
    return wrist, elbow, shoulder


def examine(path: JointPath, cell: Cell, options: Options, rate_hz: float) -> Examined:
    """All checks of a path, at `rate_hz`."""
    t = path.grid(rate_hz)
    q, qd, qdd = (path.at(t, order) for order in range(3))
    limits, arm = options.limits, cell.arm
    clearance, pair = cell.clearance(q)
    worst: dict[str, float] = {}
    found: list[Breach] = []

    def most(check: str, values: Floats, limit: Floats, unit: str, scale: float) -> None:
        """Values (n, 6) at most the limits (6,)."""
        share = values / limit
        worst[check] = float(share.max())
        over = np.flatnonzero((share > 1.0).any(axis=1))
        if len(over):
            k = over[0]
            j = int(np.argmax(share[k]))
            found.append(
                Breach(check, t[k], JOINTS[j], scale * values[k, j], scale * limit[j], unit)
            )

    def least(
        check: str, values: Floats, limit: float, where: list[str], unit: str, scale: float
    ) -> None:
        """Values (n,) at least the limit."""
        if limit <= 0:
            return
        worst[check] = float(limit / max(values.min(), 1e-9))
        under = np.flatnonzero(values < limit)
        if len(under):
            k = under[0]
            name = where[k] if len(where) > 1 else where[0]
            found.append(Breach(check, t[k], name, scale * values[k], scale * limit, unit))

    degrees = 180.0 / np.pi
    span = POSITION - np.radians(limits.margin_deg)
    most("position", np.abs(q), span, "deg", degrees)
    most("speed", np.abs(qd), arm.speed * limits.speed_percent / 100, "deg/s", degrees)
    most("acceleration", np.abs(qdd), np.full(6, limits.acceleration), "rad/s2", 1.0)
    torque = np.abs(cell.torque(q, qd, qdd))
    most("torque", torque, arm.torque * limits.torque_percent / 100, "Nm", 1.0)
    wrist, elbow, shoulder = singularity(q, arm)
    least("wrist singularity", wrist, np.radians(limits.wrist_deg), ["wrist_2"], "deg", degrees)
    least("elbow singularity", elbow, np.radians(limits.elbow_deg), ["elbow"], "deg", degrees)
    least("shoulder singularity", shoulder, limits.shoulder_m, ["wrist above base"], "mm", 1e3)
    names = [" and ".join(cell.pairs[k]) for k in pair]
    # a clearance of nothing still forbids touching
    keep = max(options.workspace.clearance_m, 1e-6)
    least("clearance", clearance, keep, names, "mm", 1e3)
    found += _outside(t, q, cell, options, worst)
    found.sort(key=lambda breach: breach.time_s)
    return Examined(
        t=t,
        breaches=tuple(found),
        worst=worst,
        clearance=clearance,
        keep_m=keep,
        speed=np.abs(qd) / arm.speed,
        ok_until_s=found[0].time_s if found else path.duration_s,
        nearest=cell.pairs[pair[int(np.argmin(clearance))]],
        extra={
            "speed_deg_s": float(np.abs(qd).max() * degrees),
            "acceleration_rad_s2": float(np.abs(qdd).max()),
            "clearance_mm": float(clearance.min() * 1e3),
            "wrist_deg": float(wrist.min() * degrees),
            "elbow_deg": float(elbow.min() * degrees),
        },
    )


def _outside(
    t: Floats, q: Floats, cell: Cell, options: Options, worst: dict[str, float]
) -> Iterator[Breach]:
    """Where the TCP leaves the box it must stay in."""
    low, high = box_limits(options.workspace)
    if not (np.isfinite(low).any() or np.isfinite(high).any()):
        return
    flange = link_frames(q, cell.dh)[:, 6]
    tool = options.flange_tcp.p
    p = flange[:, :3, :3] @ tool + flange[:, :3, 3]
    bad: Bools = (p < low) | (p > high)
    worst["workspace"] = 2.0 if bad.any() else 0.0
    rows = np.flatnonzero(bad.any(axis=1))
    if len(rows):
        k = rows[0]
        axis = int(np.argmax(bad[k]))
        limit = low[axis] if p[k, axis] < low[axis] else high[axis]
        yield Breach("workspace", t[k], f"tcp {'xyz'[axis]}", 1e3 * p[k, axis], 1e3 * limit, "mm")
