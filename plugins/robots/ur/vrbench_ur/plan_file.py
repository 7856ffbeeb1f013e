"""Plan files: JSON that holds a plan whole, and is refused where it was changed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vrbench.errors import ConfigError, DataError
from vrbench.text_file import replace_text
from vrbench_ur.picture import svg
from vrbench_ur.plan import UrPlan, as_json, plan_hash
from vrbench_ur.planner import Planner
from vrbench_ur.spline import DEGREE, JointPath

FORMAT = "vrbench-ur-plan-1"
DIGITS = 12


def write_plan(plan: UrPlan, path: Path) -> list[Path]:
    """Writes the plan and, beside it, its picture; returns both.

    Raises:
        ConfigError: the folder is not there or not writable.
    """
    told = {"format": FORMAT, **as_json(plan)}
    told["path"] = {
        "what": "joint angles [rad]: B-spline of degree 5, knots [s], one row a control point",
        "degree": DEGREE,
        "knots": np.round(plan.path.knots, DIGITS).tolist(),
        "coefficients": np.round(plan.path.coefficients, DIGITS).tolist(),
    }
    picture = path.with_suffix(".svg")
    try:
        replace_text(path, json.dumps(told, indent=1) + "\n")
        replace_text(picture, svg(plan))
    except OSError as error:
        raise ConfigError("can't be written", file=path, field="-o", fix=str(error)) from None
    return [path, picture]


def read_path(path: Path, planner: Planner) -> tuple[JointPath, str]:
    """The joint path of a plan file and its hash, for the rig that it was made for.

    Raises:
        DataError: no such file, not a plan, or a plan that was changed.
        ConfigError: the plan is of another robot model or of another rig.
    """
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError("is no plan", file=path, fix=str(error)) from None
    if not isinstance(told, dict) or told.get("format") != FORMAT:
        raise DataError("is no plan", file=path, field="format", fix=FORMAT)
    if told.get("arm") != planner.arm.name:
        raise ConfigError(
            f"is a plan for {told.get('arm')}", file=path, field="arm", fix=planner.arm.name
        )
    if told.get("rig") != planner.rig:
        raise ConfigError(
            "is a plan for another rig: tool, payload, surroundings, limits or mounting differ",
            file=path,
            field="rig",
            fix="plan the motion again with this rig",
        )
    try:
        spline = told["path"]
        knots = np.array(spline["knots"], dtype=np.float64)
        points = np.array(spline["coefficients"], dtype=np.float64)
        whole = JointPath(knots, points, float(told["lead_in_s"]), float(told["lead_out_s"]))
        sound = points.shape == (len(knots) - DEGREE - 1, 6) and np.isfinite(points).all()
    except (KeyError, TypeError, ValueError) as error:
        raise DataError("holds no path", file=path, field="path", fix=str(error)) from None
    if not sound or plan_hash(planner.rig, whole) != told.get("hash"):
        raise DataError("was changed after it was made", file=path, field="hash", fix="plan again")
    return whole, str(told["hash"])


def describe(plan: UrPlan) -> Sequence[tuple[str, str]]:
    """A plan for people: name and value."""
    told = as_json(plan)
    p = ", ".join(f"{x:g}" for x in plan.start.p_m)
    lead = plan.path.lead_in_s, plan.path.lead_out_s
    rows = [
        ("hash", plan.hash[:12]),
        ("fraction", f"strict {plan.fraction:.3f}, MoveIt's {plan.moveit:.3f}"),
        ("start", f"p_m [{p}], yaw_deg {plan.start.yaw_deg:g}"),
        ("posture", str(told["posture"])),
        ("duration", f"{plan.path.duration_s:.2f} s, stretch {plan.stretch:g}"),
        ("lead", f"{lead[0]:.2f} s before, {lead[1]:.2f} s behind" if any(lead) else "none"),
        (
            "smoothing",
            f"at most {plan.deviation_mm:.3f} mm, {plan.deviation_deg:.3f} deg at the eye",
        ),
        ("nearest", f"{' and '.join(plan.examined.nearest)}, {plan.facts['clearance_mm']:.0f} mm"),
    ]
    rows += [
        (f"{name}, of its limit", f"{100 * use:.0f} %") for name, use in plan.examined.worst.items()
    ]
    if "calibration_max_mm" in plan.facts:
        off = plan.facts
        rows.append(
            (
                "calibration",
                f"nominal off by {off['calibration_mean_mm']:.2f} mm mean, "
                f"{off['calibration_max_mm']:.2f} mm, {off['calibration_max_deg']:.3f} deg at most",
            )
        )
    return [*rows, *(("warning", warning) for warning in plan.warnings)]
