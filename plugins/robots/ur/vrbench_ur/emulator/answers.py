"""Commands of the emulated program that set or tell something, and move nothing.

Those that stand neither here nor in the controller are not emulated; the program ends on them, so
that nobody takes an old answer for a new one.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Protocol

import numpy as np

from vrbench.geometry import Transform, rotvec_to_quat
from vrbench_ur.arms import POSITION, Arm
from vrbench_ur.emulator.twin import TICK_S, Twin, rotation
from vrbench_ur.inverse import solve


class Asked(Protocol):
    """What a command is asked of: the controller, as far as answers need it."""

    arm: Arm
    twin: Twin
    payload: float
    cog: list[float]
    tcp_offset: list[float]
    out_int: list[int]
    out_double: list[float]

    def doubles(self, first: int, count: int) -> list[float]:
        """So many of a command's arguments."""
        ...

    def watch(self, frequency: float) -> None:
        """Ends the program when commands come less often than this [Hz]."""
        ...


class Ask(IntEnum):
    """Commands by the client's numbers."""

    PAYLOAD = 17
    STEP_TIME = 26
    TCP = 29
    INVERSE_NEAR = 30
    WATCHDOG = 35
    POSE_SAFE = 36
    JOINTS_SAFE = 37
    TCP_OFFSET = 40
    FORWARD = 43
    FORWARD_OF = 44
    INVERSE = 46
    STEADY = 47


def answer(command: int, controller: Asked) -> bool:
    """Does what a command asks, into the output registers; False where it isn't known."""
    doubles, twin = controller.doubles, controller.twin
    match command:
        case Ask.STEP_TIME:
            controller.out_double[0] = TICK_S
        case Ask.PAYLOAD:
            controller.payload, *controller.cog = doubles(0, 4)
        case Ask.TCP:
            controller.tcp_offset = doubles(0, 6)
            twin.tool = (rotation(controller.tcp_offset[3:]), controller.tcp_offset[:3])
        case Ask.TCP_OFFSET:
            controller.out_double[:6] = controller.tcp_offset
        case Ask.WATCHDOG:
            controller.watch(max(doubles(0, 1)[0], 0.1))
        case Ask.POSE_SAFE:
            x, y, z = doubles(0, 3)
            reach = 1.2 * controller.arm.reach + 0.3
            controller.out_int[1] = int((x * x + y * y + z * z) ** 0.5 < reach)
        case Ask.JOINTS_SAFE:
            pairs = zip(doubles(0, 6), POSITION, strict=True)
            controller.out_int[1] = int(all(abs(x) <= most for x, most in pairs))
        case Ask.FORWARD:
            controller.out_double[:6] = twin.tcp(twin.actual)
        case Ask.FORWARD_OF:
            controller.out_double[:6] = twin.tcp(doubles(0, 6))
        case Ask.INVERSE_NEAR | Ask.INVERSE:
            near = doubles(6, 6) if command == Ask.INVERSE_NEAR else list(twin.actual)
            return _inverse(controller, near)
        case Ask.STEADY:
            controller.out_int[1] = int(not twin.moving)
        case _:
            return False
    return True


def _inverse(controller: Asked, near: list[float]) -> bool:
    """Joints that bring the TCP to the pose in the registers, nearest to `near` (6) [rad].

    False where the pose is out of reach: the real program ends on that too.
    """
    pose, offset = (np.array(v) for v in (controller.doubles(0, 6), controller.tcp_offset))
    tcp = Transform(pose[:3], rotvec_to_quat(pose[3:]))
    flange = tcp @ Transform(offset[:3], rotvec_to_quat(offset[3:])).inverse()
    found = solve(flange, controller.arm.dh)
    found = found[~np.isnan(found[:, 0])]
    if not len(found):
        return False
    turns = found + 2 * np.pi * np.round((np.array(near) - found) / (2 * np.pi))
    best = turns[np.argmin(np.abs(turns - near).sum(axis=1))]
    controller.out_double[:6] = best.tolist()
    return True
