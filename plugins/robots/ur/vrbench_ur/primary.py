"""The controller's primary port, for the one thing RTDE doesn't tell: its own kinematics.

Big-endian. A message is `i32 size` (these five bytes included), `u8 type`; a robot state holds
packages of the same shape. Kinematics are six u32 checksums, then theta, a, d and alpha of the six
joints as float64, and a u32 that says whether they are calibrated: 225 bytes. The maker's guide
calls that last one a byte; the robot state of its simulator 5.8 in the tests of its own
Universal_Robots_Client_Library, against which this layout was held, has four.
"""

from __future__ import annotations

import socket
import struct
import time

import numpy as np

from vrbench_ur import rtde
from vrbench_ur.arms import Dh

HEAD = struct.Struct(">iB")
ROBOT_STATE, KINEMATICS = 16, 5
VALUES = struct.Struct(">6I24dI")
LARGEST = 1 << 20


def kinematics_message(dh: Dh, calibrated: bool) -> bytes:
    """A robot state that holds kinematics alone."""
    numbers = [float(x) for part in (dh.theta, dh.a, dh.d, dh.alpha) for x in part]
    body = VALUES.pack(*[0] * 6, *numbers, int(calibrated))
    package = HEAD.pack(HEAD.size + len(body), KINEMATICS) + body
    return HEAD.pack(HEAD.size + len(package), ROBOT_STATE) + package


def read_kinematics(host: str, timeout_s: float) -> Dh | None:
    """The controller's own parameters; None where it doesn't tell them in time."""
    deadline = time.monotonic() + timeout_s
    try:
        with socket.create_connection((host, rtde.PORT_PRIMARY), timeout_s) as connection:
            buffer = b""
            while time.monotonic() < deadline:
                data = connection.recv(65536)
                if not data:
                    return None
                buffer += data
                found, buffer = _search(buffer)
                if found is not None:
                    return found
    except (OSError, ValueError):
        return None
    return None


def _search(buffer: bytes) -> tuple[Dh | None, bytes]:
    """Kinematics in the whole messages of a buffer, and what is left of it.

    Raises:
        ValueError: sizes that no message has.
    """
    while len(buffer) >= HEAD.size:
        size, kind = HEAD.unpack_from(buffer)
        if not HEAD.size <= size <= LARGEST:
            raise ValueError(f"a message of {size} bytes")
        if len(buffer) < size:
            break
        message, buffer = buffer[HEAD.size : size], buffer[size:]
        if kind != ROBOT_STATE:
            continue
        while len(message) >= HEAD.size:
            size, kind = HEAD.unpack_from(message)
            if not HEAD.size <= size <= len(message):
                raise ValueError(f"a package of {size} bytes")
            if kind == KINEMATICS and size - HEAD.size >= VALUES.size:
                return _parameters(message[HEAD.size : size]), buffer
            message = message[size:]
    return None, buffer


def _parameters(body: bytes) -> Dh:
    values = np.array(VALUES.unpack_from(body)[6:30], dtype=np.float64).reshape(4, 6)
    theta, a, d, alpha = values
    return Dh(d=d, a=a, alpha=alpha, theta=theta)
