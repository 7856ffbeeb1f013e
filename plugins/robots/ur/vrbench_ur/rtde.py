"""RTDE, Universal Robots' Real-Time Data Exchange: framing, names and types of its variables.

Big-endian. A message is `u16 size` (these three bytes included), `u8 type`, payload.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence

PORT_RTDE, PORT_SCRIPT, PORT_DASHBOARD, PORT_PRIMARY = 30004, 30003, 29999, 30001

VERSION_REQUEST, CONTROLLER_VERSION = 86, 118
TEXT = 77
SETUP_OUTPUTS, SETUP_INPUTS = 79, 73
START, PAUSE = 83, 80
DATA = 85
PROTOCOL = 2
HEADER = struct.Struct(">HB")
LARGEST = 4096

RUNTIME_STOPPED, RUNTIME_PLAYING, RUNTIME_PAUSED = 1, 2, 4
# Bits of safety_status_bits.
NORMAL, REDUCED, PROTECTIVE, SAFEGUARD, EMERGENCY, STOPPED = 0, 1, 2, 4, 7, 10

CODES = {
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "INT32": "i",
    "UINT32": "I",
    "UINT64": "Q",
    "UINT8": "B",
    "VECTOR6INT32": "6i",
    "BOOL": "?",
}
"""struct codes by RTDE type."""

_BY_TYPE = {
    "VECTOR6D": (
        "target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_qdd "
        "actual_current actual_current_as_torque actual_moment joint_control_output "
        "actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose target_TCP_speed "
        "joint_temperatures actual_joint_voltage ft_raw_wrench payload_inertia"
    ),
    "VECTOR3D": "actual_tool_accelerometer payload_cog elbow_position elbow_velocity",
    "DOUBLE": (
        "timestamp actual_execution_time speed_scaling target_speed_fraction actual_momentum "
        "actual_main_voltage actual_robot_voltage actual_robot_current standard_analog_input0 "
        "standard_analog_input1 standard_analog_output0 standard_analog_output1 payload "
        "tcp_force_scalar"
    ),
    "UINT64": "actual_digital_input_bits actual_digital_output_bits",
    "INT32": "robot_mode safety_mode safety_status",
    "VECTOR6INT32": "joint_mode",
    "UINT32": (
        "runtime_state robot_status_bits safety_status_bits output_bit_registers0_to_31 "
        "output_bit_registers32_to_63"
    ),
}
OUTPUTS: Mapping[str, str] = {
    **{name: kind for kind, names in _BY_TYPE.items() for name in names.split()},
    **{f"output_int_register_{i}": "INT32" for i in range(48)},
    **{f"output_double_register_{i}": "DOUBLE" for i in range(48)},
}
"""Types of the variables a controller sends."""
INPUTS: Mapping[str, str] = {
    **{f"input_int_register_{i}": "INT32" for i in range(48)},
    **{f"input_double_register_{i}": "DOUBLE" for i in range(48)},
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    "standard_digital_output_mask": "UINT8",
    "standard_digital_output": "UINT8",
    "configurable_digital_output_mask": "UINT8",
    "configurable_digital_output": "UINT8",
    "tool_digital_output_mask": "UINT8",
    "tool_digital_output": "UINT8",
    "standard_analog_output_mask": "UINT8",
    "standard_analog_output_type": "UINT8",
    "standard_analog_output_0": "DOUBLE",
    "standard_analog_output_1": "DOUBLE",
    "external_force_torque": "VECTOR6D",
}
"""Types of the variables a client may send."""


def message(kind: int, payload: bytes = b"") -> bytes:
    """A framed message."""
    return HEADER.pack(HEADER.size + len(payload), kind) + payload


def layout(kinds: Sequence[str]) -> struct.Struct:
    """The packed values of a recipe with these types, behind its id."""
    return struct.Struct(">" + "".join(CODES[kind] for kind in kinds))


class Framing:
    """Cuts a stream of bytes into messages."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Types and payloads of the messages that are whole now.

        Raises:
            ValueError: what came isn't RTDE.
        """
        self._buffer += data
        while len(self._buffer) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._buffer)
            if not HEADER.size <= size <= LARGEST:
                raise ValueError(f"a message of {size} bytes")
            if len(self._buffer) < size:
                return
            payload = bytes(self._buffer[HEADER.size : size])
            del self._buffer[:size]
            yield kind, payload
