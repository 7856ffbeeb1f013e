"""`calibration.json`: what the calibrations found, by protocol and reference."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from vrbench.config.strict import Strict
from vrbench.config.yaml_file import validate
from vrbench.errors import DataError
from vrbench.protocols.calibration import Calibration
from vrbench.text_file import replace_text

CALIBRATIONS = "calibration.json"

Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Four = Annotated[list[float], Field(min_length=4, max_length=4)]
Six = Annotated[list[float], Field(min_length=6, max_length=6)]


class PoseRecord(Strict):
    """A transform: position [m], quaternion xyzw."""

    p_m: Three
    q_xyzw: Four


class CalibrationRecord(Strict):
    """What one calibration take gave: X with its covariance, Y, and what they leave."""

    take: str
    tcp_eye: PoseRecord
    tcp_eye_covariance: Annotated[list[Six], Field(min_length=6, max_length=6)] | None
    base_world: PoseRecord
    residual_mm: float
    residual_deg: float


class _File(Strict):
    protocols: dict[str, dict[str, list[CalibrationRecord]]]


def parse_calibrations(
    content: bytes, path: Path, protocol: str
) -> dict[str, list[CalibrationRecord]]:
    """What a protocol found, by reference; nothing where it found nothing.

    Raises:
        DataError: the content isn't what `write_calibrations` wrote.
        ConfigError: a field isn't what it should be.
    """
    try:
        found = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise DataError("is not JSON", file=path, fix=str(error)) from None
    return validate(found, _File, path).protocols.get(protocol, {})


def write_calibrations(
    path: Path, protocol: str, found: Mapping[str, Sequence[Calibration]]
) -> None:
    """Writes what a protocol found for each reference; what other protocols found stays."""
    content = {
        reference: [_entry(calibration) for calibration in calibrations]
        for reference, calibrations in found.items()
    }
    protocols = {**_protocols(path), protocol: content}
    replace_text(path, json.dumps({"protocols": protocols}, indent=1, sort_keys=True))


def _entry(calibration: Calibration) -> dict[str, Any]:
    x, y, covariance = calibration.x, calibration.y, calibration.x_covariance
    return {
        "take": calibration.take,
        "tcp_eye": {"p_m": x.p.tolist(), "q_xyzw": x.q.tolist()},
        "tcp_eye_covariance": None if covariance is None else covariance.tolist(),
        "base_world": {"p_m": y.p.tolist(), "q_xyzw": y.q.tolist()},
        "residual_mm": calibration.translation_residual_m * 1e3,
        "residual_deg": math.degrees(calibration.rotation_residual_rad),
    }


def _protocols(path: Path) -> dict[str, Any]:
    """What stands in the file already; a file of another shape is made anew."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return {}
    protocols = content.get("protocols") if isinstance(content, dict) else None
    return protocols if isinstance(protocols, dict) else {}
