"""A controller's own kinematic calibration: the deviations of one arm from its published model.

The controller keeps it as text, `calibration.conf`, with lists `delta_theta`, `delta_a`, `delta_d`
and `delta_alpha`, one value a joint.
"""

from __future__ import annotations

import configparser
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vrbench.errors import ConfigError
from vrbench.geometry import Floats, relative_angle
from vrbench_ur.arms import Arm, Dh
from vrbench_ur.kinematics import flange

KEYS = ("delta_theta", "delta_a", "delta_d", "delta_alpha")
# Larger deviations than these are another robot's file, or another thing [rad], [m].
MOST_RAD = 0.2
MOST_A_M = 0.05


@dataclass(frozen=True, slots=True)
class Difference:
    """How far a calibrated arm's flange is from the nominal one's, along a path.

    Attributes:
        mean_mm, max_mm: distance of the positions.
        max_deg: angle between the orientations.
    """

    mean_mm: float
    max_mm: float
    max_deg: float


def read_calibration(path: Path, arm: Arm) -> Dh:
    """The parameters of a calibrated arm.

    Raises:
        ConfigError: no such file, not a calibration.conf, values that are no arm's.
    """
    parser = configparser.ConfigParser(strict=True)
    try:
        parser.read_string(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError("can't be read", file=path, fix=str(error)) from None
    except (configparser.Error, UnicodeDecodeError) as error:
        raise ConfigError(
            "is not a controller's calibration.conf", file=path, fix=str(error).split("\n")[0]
        ) from None
    if not parser.has_section("mounting"):
        raise ConfigError("has no section [mounting]", file=path, fix="the file calibration.conf")
    theta, a, d, alpha = (_values(parser, key, path) for key in KEYS)
    for key, values, most in (
        ("delta_theta", theta, np.pi),
        ("delta_a", a, MOST_A_M),
        ("delta_alpha", alpha, MOST_RAD),
    ):
        if np.abs(values).max() > most:
            raise ConfigError(
                f"{np.abs(values).max():.4g} is no deviation of an arm that works",
                file=path,
                field=key,
                fix=f"at most {most:.4g}",
            )
    dh = arm.dh
    return Dh(d=dh.d + d, a=dh.a + a, alpha=dh.alpha + alpha, theta=dh.theta + theta)


def _values(parser: configparser.ConfigParser, key: str, path: Path) -> Floats:
    text = parser.get("mounting", key, fallback="")
    try:
        values = np.array([float(part) for part in text.strip(" []\t").split(",")])
    except ValueError:
        values = np.empty(0)
    if values.shape != (6,) or not np.isfinite(values).all():
        raise ConfigError(f"found {text!r}", file=path, field=key, fix="six numbers in brackets")
    return values


def difference(q: Floats, nominal: Dh, calibrated: Dh) -> Difference:
    """Between the two models' flanges at joint angles (n, 6) [rad]."""
    a, b = flange(q, nominal), flange(q, calibrated)
    apart = 1e3 * np.linalg.norm(a.p - b.p, axis=1)
    return Difference(
        float(apart.mean()), float(apart.max()), float(np.degrees(relative_angle(a.q, b.q).max()))
    )
