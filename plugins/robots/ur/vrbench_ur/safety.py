"""What must hold before and while a real arm moves. None of it is safety-rated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vrbench.errors import ConfigError, DeviceError
from vrbench.geometry import Floats
from vrbench_ur.arms import JOINTS, Arm

# How fast the arm goes to where a plan starts: share of its speed, and acceleration [rad/s2].
APPROACH_SPEED, APPROACH_ACCELERATION = 0.15, 0.3
# A move that the client would wait for longer than this comes back as failed [s].
LONGEST_MOVE_S = 300.0
# One servoJ command may be this much of the speed limit's step away from the one before.
STEP_SHARE = 1.25


# By importance: the first that is set is told.
SAFETY = {
    7: "emergency stop",
    5: "system emergency stop",
    6: "emergency stop at the robot",
    8: "safety violation",
    9: "safety fault",
    2: "protective stop",
    4: "safeguard stop",
    3: "recovery mode",
    1: "reduced mode: its limits are not those of the plan",
    10: "stopped by its safety system",
}


class RobotFaultError(DeviceError):
    """The robot stopped, or had to be stopped. Stays until the session ends: nothing resumes."""


@dataclass(frozen=True, slots=True)
class Approach:
    """How the arm gets to where a plan starts.

    Attributes:
        speed: of the fastest joint [rad/s].
        duration_s: about how long it takes.
    """

    speed: float
    duration_s: float


def check_payload(arm: Arm, kg: float) -> None:
    """Refuses what the arm may not carry.

    Raises:
        ConfigError: the payload is above the arm's limit.
    """
    if kg > arm.payload_kg:
        raise ConfigError(
            f"{kg:g} kg is above the payload of {arm.name}",
            field="robot.options.payload.kg",
            fix=f"at most {arm.payload_kg:g} kg",
        )


def approach(arm: Arm, here: Floats, start: Floats) -> Approach:
    """A slow move of the joints (6,) [rad] from `here` to `start`.

    Raises:
        ConfigError: it would take longer than the client waits for a move.
    """
    far = float(np.abs(start - here).max())
    speed = APPROACH_SPEED * float(arm.speed.min())
    ramp = speed / APPROACH_ACCELERATION
    duration = (
        far / speed + ramp if far > speed * ramp else 2 * np.sqrt(far / APPROACH_ACCELERATION)
    )
    check_blocking(duration)
    return Approach(speed, float(duration))


def check_blocking(duration_s: float) -> None:
    """Refuses a blocking move that the client gives up on.

    Raises:
        ConfigError: it is longer than 300 s.
    """
    if duration_s > LONGEST_MOVE_S:
        raise ConfigError(
            f"a blocking move of {duration_s:.0f} s is longer than the client waits",
            fix=f"at most {LONGEST_MOVE_S:.0f} s; replay goes by servoJ and has no such limit",
        )


def safety_text(bits: int) -> str:
    """What safety_status_bits other than normal mean, and what to do."""
    for bit, what in SAFETY.items():
        if bits & (1 << bit):
            return f"{what}; nothing goes on by itself: look at the arm, clear it at the pendant"
    return f"safety bits {bits:#x} are set"


def check_measured(arm: Arm, measured: Floats, planned: Floats, tolerance_rad: float) -> None:
    """Refuses to start where the plan doesn't.

    Raises:
        DeviceError: a joint (6,) [rad] is farther than the tolerance from the plan's start.
    """
    off = np.abs(measured - planned)
    j = int(np.argmax(off))
    if not off[j] <= tolerance_rad:
        raise DeviceError(
            f"{arm.name} is not where the plan starts: {JOINTS[j]} is at "
            f"{np.degrees(measured[j]):.2f} deg, the plan at {np.degrees(planned[j]):.2f} deg",
            fix="nothing was replayed; let the approach finish, or move the arm there",
        )


def clamp(command: Floats, last: Floats, speed: Floats, period_s: float) -> tuple[Floats, bool]:
    """The next command (6,), no farther from the last than the speed limits allow; and whether cut.

    A plan that was checked is never cut; what is, is a fault.
    """
    most = STEP_SHARE * speed * period_s
    step = np.clip(command - last, -most, most)
    return last + step, bool(np.any(np.abs(command - last) > most))
