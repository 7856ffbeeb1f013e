"""The emulated controller: registers, the program that runs on it, and what keeps it from running.

The program is the client's own script, of which only the meaning of its commands is known here: a
number in input register 0, its arguments in the other registers, and the answer in output 0.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

from vrbench_ur import rtde
from vrbench_ur.arms import Arm
from vrbench_ur.emulator.answers import answer
from vrbench_ur.emulator.twin import TICK_S, Twin
from vrbench_ur.kinematics import flange_once

READY, DONE = 1, 2
# Commands that are done at once and leave the program ready: servoJ and its like.
REAL_TIME = {6, 9, 10, 11, 24, 25, 26, 27, 38, 58, *range(66, 72)}
MOVE_J, SERVO_J, SPEED_STOP, SERVO_STOP, PROTECTIVE_STOP = 1, 11, 15, 16, 31
STOP_L, STOP_J, PATH, END_SCRIPT = 33, 34, 45, 255
# Past this, a joint's own safety limit stops the arm [rad].
JOINT_END = 2 * math.pi + math.radians(3.0)
# Bits of the word that tells of a move that the client doesn't wait for.
ASYNC_RUNNING, ASYNC_COUNT, ASYNC_ID = 1 << 15, 16, 24
UNLOCK_AFTER_S = 5.0
MOVE = re.compile(
    r"movej\(\[([^\]]*)\]\s*,\s*a=([0-9.eE+-]+)\s*,\s*v=([0-9.eE+-]+)\s*,\s*r=([0-9.eE+-]+)\)"
)


class Controller:
    """One controller.

    Attributes:
        twin: its arm.
        tick_count: ticks of 2 ms since it was switched on.
        inputs: values that clients wrote, by variable.
        runtime: its program's state.
        safety: bits of safety_status_bits.
        remote: whether remote control is on.
        events: (tick, what happened), for tests.
    """

    def __init__(self, arm: Arm, seed: int, log: Callable[[str], None] | None = None) -> None:
        self.arm, self.twin = arm, Twin(arm, seed)
        self.tick_count = 0
        self.inputs: dict[str, Any] = {}
        self.out_int, self.out_double = [0] * 48, [0.0] * 48
        self.runtime = rtde.RUNTIME_STOPPED
        self.safety = {rtde.NORMAL}
        self.remote = True
        self.payload, self.cog = 0.0, [0.0, 0.0, 0.0]
        self.tcp_offset = [0.0] * 6
        self.slider, self.digital_out = 1.0, 0
        self.events: list[tuple[int, str]] = []
        self._log = log
        self._script = ""
        self._command, self._working = 0, False
        self._then: Callable[[], None] | None = None
        self._stopped_at = 0
        self._watchdog: tuple[float, int] | None = None
        self._was_moving = False
        self._async = False

    def note(self, what: str) -> None:
        """Keeps an event with its tick."""
        self.events.append((self.tick_count, what))
        if self._log is not None:
            self._log(f"{self.tick_count} {what}")

    # -- what clients do

    def write(self, name: str, value: Any) -> None:
        """A client wrote an input variable."""
        self.inputs[name] = value
        if name == "input_int_register_0" and self._watchdog is not None:
            self._watchdog = (self._watchdog[0], self.tick_count)
        elif name == "speed_slider_fraction" and self.inputs.get("speed_slider_mask"):
            self.set_slider(float(value))
        elif name == "standard_digital_output":
            mask = int(self.inputs.get("standard_digital_output_mask", 0))
            self.digital_out = (self.digital_out & ~mask) | (int(value) & mask)

    def set_slider(self, fraction: float) -> None:
        """The speed slider, 0..1."""
        self.slider = min(max(fraction, 0.0), 1.0)
        self.note(f"slider {self.slider:g}")

    def upload(self, script: str) -> None:
        """A program came in on the script port, and starts."""
        if self.safety & {rtde.PROTECTIVE, rtde.EMERGENCY}:
            self.note("script refused")
            return
        self._script = script
        self.runtime = rtde.RUNTIME_PLAYING
        self._working, self._command, self._then, self._watchdog = False, 0, None, None
        self.out_int[0] = 0
        self.note("program")

    def stop_program(self, why: str) -> None:
        """Ends the program; the arm brakes."""
        if self.runtime != rtde.RUNTIME_STOPPED:
            self.note(f"program stopped: {why}")
        self.runtime = rtde.RUNTIME_STOPPED
        self.out_int[0] = 0
        self._then, self._watchdog, self._working = None, None, False
        self.twin.stop(8.0)

    # -- what goes wrong

    def protective_stop(self) -> None:
        """The arm stops hard; the program is paused until a person clears it."""
        self.safety = {rtde.PROTECTIVE, rtde.STOPPED}
        self._stopped_at = self.tick_count
        if self.runtime == rtde.RUNTIME_PLAYING:
            self.runtime = rtde.RUNTIME_PAUSED
        self.twin.stop(40.0)
        self.note("protective stop")

    def emergency_stop(self) -> None:
        """Power is cut; the program ends."""
        self.safety = {rtde.EMERGENCY, rtde.STOPPED, 6}
        self.twin.stop(40.0)
        self.stop_program("emergency stop")
        self.note("emergency stop")

    def safeguard_stop(self) -> None:
        """Somebody opened the door; the program is paused."""
        self.safety = {rtde.SAFEGUARD, rtde.STOPPED}
        if self.runtime == rtde.RUNTIME_PLAYING:
            self.runtime = rtde.RUNTIME_PAUSED
        self.twin.stop(40.0)
        self.note("safeguard stop")

    def unlock(self) -> bool:
        """Ends a protective stop, five seconds after it began at the earliest."""
        waited = (self.tick_count - self._stopped_at) * TICK_S
        if rtde.PROTECTIVE not in self.safety or waited < UNLOCK_AFTER_S:
            return False
        self.safety = {rtde.NORMAL}
        self.note("unlocked")
        return True

    def clear(self) -> None:
        """All is well again, as after a person went there."""
        self.safety = {rtde.NORMAL}
        self.note("cleared")

    @property
    def safety_bits(self) -> int:
        return sum(1 << bit for bit in self.safety)

    @property
    def safety_mode(self) -> int:
        modes = {rtde.PROTECTIVE: 3, rtde.SAFEGUARD: 5, rtde.EMERGENCY: 7, rtde.REDUCED: 2}
        return next((mode for bit, mode in modes.items() if bit in self.safety), 1)

    # -- time

    def tick(self) -> None:
        """Two milliseconds go by."""
        self.tick_count += 1
        if self.runtime == rtde.RUNTIME_PLAYING:
            self._run()
        self.twin.scaling = self.slider
        self.twin.tick()
        if max(map(abs, self.twin.q)) > JOINT_END and rtde.PROTECTIVE not in self.safety:
            self.note("joint limit")
            self.protective_stop()
        if self._async and not self.twin.busy:
            self._tell_async(running=False)
        moving = self.twin.moving
        if moving != self._was_moving:
            self.note("moves" if moving else "rests")
            self._was_moving = moving
        if self._watchdog is not None and self.runtime == rtde.RUNTIME_PLAYING:
            frequency, since = self._watchdog
            if (self.tick_count - since) * TICK_S > 1.0 / frequency:
                self.stop_program("watchdog")

    def _run(self) -> None:
        """One turn of the program's loop."""
        command = int(self.inputs.get("input_int_register_0", 0))
        if self._then is not None:
            if self.twin.busy:
                return
            then, self._then = self._then, None
            then()
        if command in REAL_TIME:
            if self._real_time(command):
                self.out_int[0] = READY
                self._working = False
        elif command == 0:
            self._working = False
            self.out_int[0] = READY
        elif not self._working:
            self._working = True
            self.out_int[0] = 0
            self._start(command)

    def doubles(self, first: int, count: int) -> list[float]:
        """What clients wrote into the registers of numbers."""
        return [
            float(self.inputs.get(f"input_double_register_{i}", 0.0))
            for i in range(first, first + count)
        ]

    def watch(self, frequency: float) -> None:
        """Ends the program when commands come less often than this [Hz]."""
        self._watchdog = (frequency, self.tick_count)

    def _unknown(self, command: int) -> None:
        self.stop_program(f"command {command} is not emulated, or has no answer")

    def _real_time(self, command: int) -> bool:
        """Whether the program goes on."""
        if command == SERVO_J:
            goal = self.doubles(0, 6)
            if self._command != SERVO_J:
                self.note("servo")
            self.twin.servo(goal, self.doubles(9, 1)[0])
        elif not answer(command, self):
            self._unknown(command)
            return False
        self._command = command
        return True

    def _done(self) -> None:
        self.out_int[0] = DONE

    def _start(self, command: int) -> None:
        """Begins a command that ends: DONE is set when it has."""
        self._command = command
        self.note(f"command {command}")
        if command == MOVE_J:
            q, (speed, acceleration) = self.doubles(0, 6), self.doubles(6, 2)
            self.twin.move(q, max(speed, 1e-3), max(acceleration, 1e-3))
            self._finish()
        elif command == PATH:
            self.twin.follow(self._path())
            self._finish()
        elif command in (SPEED_STOP, SERVO_STOP, STOP_L, STOP_J):
            # of the tool [m/s2]; half a metre of lever makes it the joints' [rad/s2]
            lever = 1.0 if command == STOP_J else 0.5
            self.twin.stop(self.doubles(0, 1)[0] / lever)
            self._finish(wait=True)
        elif command == PROTECTIVE_STOP:
            self.protective_stop()
            self._done()
        elif command == END_SCRIPT:
            self.stop_program("asked to")
        elif answer(command, self):
            self._done()
        else:
            self._unknown(command)

    def _finish(self, wait: bool = False) -> None:
        """DONE when the arm has arrived; at once where the client doesn't wait."""
        if self.inputs.get("input_int_register_1") == 1 and not wait:
            self._tell_async(running=True)
            self._done()
        else:
            self._then = self._done

    def _tell_async(self, *, running: bool) -> None:
        """The word of a move that nobody waits for: its number, how often it changed, running."""
        word = self.out_int[2]
        number = ((word >> ASYNC_ID) + running) & 0x7F
        count = ((word >> ASYNC_COUNT) + 1) & 0x7F
        self._async = running
        self.out_int[2] = number << ASYNC_ID | count << ASYNC_COUNT | ASYNC_RUNNING * running

    def _path(self) -> list[tuple[list[float], float, float]]:
        """The waypoints that the client wrote into its script."""
        points = []
        for joints, acceleration, speed, _ in MOVE.findall(self._script):
            q = [float(x) for x in joints.split(",")]
            points.append((q, max(float(speed), 1e-3), float(acceleration)))
        return points or [(list(self.twin.q), 1.0, 1.0)]

    # -- what clients read

    def outputs(self, names: list[str]) -> list[Any]:
        """Values of output variables, flattened in order."""
        twin, flat = self.twin, []
        seen = twin.encoders()
        for name in names:
            value = self._value(name, seen)
            flat += value if isinstance(value, list) else [value]
        return flat

    def _value(self, name: str, seen: list[float]) -> Any:
        twin = self.twin
        match name:
            case "timestamp":
                return self.tick_count * TICK_S
            case "actual_q":
                return seen
            case "target_q":
                return twin.q
            case "actual_qd":
                return twin.actual_qd
            case "target_qd":
                return twin.qd
            case "actual_TCP_pose":
                return twin.tcp(seen)
            case "target_TCP_pose":
                return twin.tcp(twin.q)
            case "runtime_state":
                return self.runtime
            case "robot_status_bits":
                power = rtde.EMERGENCY not in self.safety
                return power + 2 * (self.runtime == rtde.RUNTIME_PLAYING)
            case "safety_status_bits":
                return self.safety_bits
            case "safety_mode" | "safety_status":
                return self.safety_mode
            case "robot_mode":
                return 3 if rtde.EMERGENCY in self.safety else 7
            case "speed_scaling":
                return 0.0 if rtde.STOPPED in self.safety else self.slider
            case "target_speed_fraction":
                return self.slider
            case "payload":
                return self.payload
            case "payload_cog":
                return list(self.cog)
            case "actual_digital_output_bits":
                return self.digital_out
            case "standard_analog_output0" | "standard_analog_output1":
                return float(self.inputs.get(f"standard_analog_output_{name[-1]}", 0.0))
            case "joint_mode":
                return [253] * 6
        kind, _, number = name.rpartition("_register_")
        if kind == "output_int":
            return self.out_int[int(number)]
        if kind == "output_double":
            return self.out_double[int(number)]
        width = {"VECTOR6D": 6, "VECTOR3D": 3}.get(rtde.OUTPUTS[name], 0)
        return [0.0] * width if width else 0

    def flange(self) -> list[float]:
        """Position of the flange (3) [m]."""
        return flange_once(self.twin.q, self.arm.dh)[1]
