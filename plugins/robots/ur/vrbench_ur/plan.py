"""A plan: the joints over time, what it was planned for, and what was found of it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vrbench.devices.ports import Plan
from vrbench.geometry import Floats, Transform
from vrbench_ur.arms import Arm, Dh
from vrbench_ur.checks import Examined
from vrbench_ur.inverse import branch_name
from vrbench_ur.options import Options, Start
from vrbench_ur.spline import JointPath


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class UrPlan(Plan):
    """A plan for one arm in one rig; more than the port asks for.

    Attributes:
        arm: the arm's name.
        rig: sha256 of what it was planned for: `rig_digest`.
        path: the joints over time.
        start: where the eye starts.
        branch: which posture.
        moveit: the fraction as MoveIt counts it.
        examined: the checks along the path.
        deviation_mm, deviation_deg: of the smoothed path from the motion, at the eye: the most.
        facts: further numbers, by name with unit.
        warnings: a sentence each.
    """

    arm: str
    rig: str
    path: JointPath
    start: Start
    branch: int
    moveit: float
    examined: Examined
    deviation_mm: float
    deviation_deg: float
    facts: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


def rig_digest(arm: Arm, options: Options, mounting: Transform, dh: Dh) -> str:
    """Of all that people allow with a plan but the motion: a plan for another rig has another.

    That is the arm, its address, tool, payload, surroundings, limits and mounting, and how it is
    followed (gain, watchdog, when it is given up). What only logging hangs on is left out.
    """
    told = options.model_dump(mode="json")
    for name in ("start", "calibration", "rate_hz", "timeout_s"):
        told.pop(name)
    told["arm"] = arm.name
    told["dh"] = [np.round(x, 9).tolist() for x in (dh.d, dh.a, dh.alpha, dh.theta)]
    told["mounting"] = np.round(np.concatenate((mounting.p, mounting.q)), 6).tolist()
    text = json.dumps(told, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def plan_hash(rig: str, path: JointPath) -> str:
    """Of the rig and of the path, rounded to 1e-9."""
    numbers = np.concatenate((path.knots, path.coefficients.ravel()))
    payload = np.rint(numbers * 1e9).astype("<i8").tobytes()
    return hashlib.sha256(rig.encode() + payload).hexdigest()


def as_json(plan: UrPlan) -> dict[str, Any]:
    """What a plan says of itself, in JSON's types; the path apart."""
    checks = plan.examined
    return {
        "hash": plan.hash,
        "arm": plan.arm,
        "rig": plan.rig,
        "fraction": plan.fraction,
        "fraction_moveit": plan.moveit,
        "stretch": plan.stretch,
        "duration_s": plan.path.duration_s,
        "lead_in_s": plan.path.lead_in_s,
        "lead_out_s": plan.path.lead_out_s,
        "start": {"p_m": list(plan.start.p_m), "yaw_deg": plan.start.yaw_deg},
        "posture": branch_name(plan.branch),
        "branch": plan.branch,
        "smoothing": {"max_mm": plan.deviation_mm, "max_deg": plan.deviation_deg},
        "use_of_limits": {name: round(use, 6) for name, use in checks.worst.items()},
        "nearest": list(checks.nearest),
        "facts": {name: round(value, 6) for name, value in plan.facts.items()},
        "warnings": list(plan.warnings),
    }


def start_posture(plan: UrPlan) -> Floats:
    """The joints (6,) [rad] from which the path starts."""
    q: Floats = plan.path.at(np.zeros(1))[0]
    return q
