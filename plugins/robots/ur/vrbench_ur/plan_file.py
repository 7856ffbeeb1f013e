"""Plan files: a plan as JSON for whoever looks at it, and as text and picture for people."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vrbench.errors import ConfigError
from vrbench.text_file import replace_text
from vrbench_ur.picture import svg
from vrbench_ur.plan import UrPlan, as_json
from vrbench_ur.spline import DEGREE

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
