"""What is looked at while the arm moves, packet by packet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vrbench.geometry import Floats
from vrbench_ur import rtde
from vrbench_ur.arms import JOINTS
from vrbench_ur.safety import safety_text

# Speed scaling below which the arm does not do what was planned.
FULL_SPEED = 0.999


class FaultError(Exception):
    """The arm has to be stopped, or has stopped."""


def check_packet(packet: Any, *, full_speed: bool) -> None:
    """Whether the controller says that all is well.

    Args:
        packet: of `vrbench_ur.reader`.
        full_speed: whether it must move at its full speed.

    Raises:
        FaultError: a stop, a program that ended, or a speed other than full.
    """
    bits = int(packet["safety_status_bits"])
    if bits & ~(1 << rtde.NORMAL):
        raise FaultError(safety_text(bits))
    if int(packet["runtime_state"]) != rtde.RUNTIME_PLAYING:
        raise FaultError("the program on the controller was stopped")
    speed = min(float(packet["speed_scaling"]), float(packet["target_speed_fraction"]))
    if full_speed and speed < FULL_SPEED:
        raise FaultError(f"the speed slider is at {100 * speed:.0f} %: the run would be invalid")


def off_track(packet: Any, sent: Sequence[Floats], most: float, at_s: float) -> float:
    """How far the arm is from where it was sent within the last moments [rad].

    It lags, so the nearest of the commands (each (6,) [rad]) counts.

    Raises:
        FaultError: farther than `most`.
    """
    off = np.abs(np.array(sent) - packet["actual_q"])
    nearest = int(np.argmin(off.max(axis=1)))
    error = float(off[nearest].max())
    if error > most:
        joint = JOINTS[int(np.argmax(off[nearest]))]
        raise FaultError(f"{joint} is {np.degrees(error):.1f} deg from its command at {at_s:.2f} s")
    return error
