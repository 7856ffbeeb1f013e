"""Universal Robots' e-Series for vrbench: plans head motions, replays them, and never in a hurry.

Only the hook stands here; what it returns is imported when it is called, so that listing plugins
stays quick. Nothing in this package is safety-rated.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from vrbench.plugin import hookimpl

if TYPE_CHECKING:
    from vrbench.devices.specs import RobotSpec


@hookimpl
def vrbench_robots() -> Sequence[RobotSpec]:
    """ur3e, ur5e, ur10e."""
    from vrbench_ur.specs import ROBOTS

    return ROBOTS
