"""`calibration.json`: what each mount's calibrations found, by reference."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from vrbench.protocols.calibration import Calibration
from vrbench.results.bundle import replace_text


def write_calibrations(
    path: Path, protocol: str, found: Mapping[str, Sequence[Calibration]]
) -> None:
    """Writes X, Y and residuals of the calibrations found for each reference."""
    content = {
        "protocol": protocol,
        "references": {
            reference: [
                {
                    "take": c.take,
                    "tcp_eye": {"p_m": c.x.p.tolist(), "q_xyzw": c.x.q.tolist()},
                    "base_world": {"p_m": c.y.p.tolist(), "q_xyzw": c.y.q.tolist()},
                    "residual_mm": c.translation_residual_m * 1e3,
                    "residual_deg": math.degrees(c.rotation_residual_rad),
                }
                for c in calibrations
            ]
            for reference, calibrations in found.items()
        },
    }
    replace_text(path, json.dumps(content, indent=1))
