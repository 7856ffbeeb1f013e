"""Looks at a controller without moving anything: is it the arm that the rig names, and ready."""

from __future__ import annotations

import socket
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from vrbench.devices.ports import Finding
from vrbench.errors import ConfigError, DeviceError
from vrbench_ur import rtde
from vrbench_ur.arms import Arm
from vrbench_ur.calibration import difference, read_calibration
from vrbench_ur.options import Options
from vrbench_ur.primary import read_kinematics
from vrbench_ur.reader import Reader
from vrbench_ur.safety import check_payload, safety_text

E_SERIES = 5
# Longer than any line of a dashboard.
LONGEST_LINE = 4096
# Farther off than arms are from their published model [mm].
MOST_OFF_MM = 20.0


class Dashboard:
    """The controller's dashboard port: a line in, a line out.

    Raises:
        DeviceError: nobody answers, not in time, or what answers is no dashboard.
    """

    def __init__(self, host: str, timeout_s: float) -> None:
        self.host, self._timeout = host, timeout_s
        try:
            self._socket = socket.create_connection((host, rtde.PORT_DASHBOARD), timeout_s)
        except OSError as error:
            raise DeviceError(
                f"no controller answers at {host}, port {rtde.PORT_DASHBOARD}",
                field="robot.options.host",
                fix="is it switched on, and the address right? is the dashboard server allowed "
                f"(PolyScope X has none)? {error}",
            ) from None
        self._text = b""
        try:
            greeting = self._line()
            if "dashboard" not in greeting.lower():
                raise DeviceError(
                    f"what answers at {host}, port {rtde.PORT_DASHBOARD}, is no dashboard: "
                    f"{greeting[:60]!r}",
                    field="robot.options.host",
                    fix="is this the robot's address?",
                )
        except BaseException:
            self._socket.close()
            raise

    def _line(self) -> str:
        # bytes that trickle in without a line's end must not wait for ever
        deadline = time.monotonic() + self._timeout
        try:
            while b"\n" not in self._text:
                left = deadline - time.monotonic()
                if left <= 0 or len(self._text) > LONGEST_LINE:
                    raise TimeoutError
                self._socket.settimeout(left)
                data = self._socket.recv(4096)
                if not data:
                    raise OSError("the connection was closed")
                self._text += data
        except TimeoutError:
            raise DeviceError(
                f"{self.host} accepts connections and stays mute (no line from its dashboard)",
                field="robot.options.host",
                fix="is this the robot's address? restart the controller if it is",
            ) from None
        except OSError as error:
            raise DeviceError(f"{self.host}: the dashboard broke off: {error}") from None
        line, _, self._text = self._text.partition(b"\n")
        return line.decode(errors="replace").strip()

    def ask(self, what: str) -> str:
        """The answer to a line."""
        try:
            self._socket.sendall((what + "\n").encode())
        except OSError as error:
            raise DeviceError(f"{self.host}: the dashboard broke off: {error}") from None
        return self._line()

    def close(self) -> None:
        self._socket.close()


def check_controller(arm: Arm, options: Options) -> None:
    """Refuses a controller that is not the rig's arm, or can't be moved from here now.

    Raises:
        ConfigError: another model, remote control off, this isn't Linux, too much payload.
        DeviceError: no answer, a mute one, or a robot that isn't running.
    """
    check_payload(arm, options.payload.kg)
    if sys.platform != "linux":
        raise ConfigError("a robot is controlled from Linux only", fix="plan here, run on Linux")
    dashboard = Dashboard(options.host, options.timeout_s)
    try:
        model = dashboard.ask("get robot model").upper()
        if not model.startswith(arm.model) or model.removeprefix(arm.model)[:1].isdigit():
            raise ConfigError(
                f"the robot at {options.host} is a {model}",
                field="robot.plugin",
                fix=f"the rig says {arm.name}, a plan for it would be wrong here",
            )
        if dashboard.ask("is in remote control").lower() != "true":
            raise ConfigError(
                f"remote control is off at {options.host}",
                field="robot",
                fix="switch the pendant from Local to Remote Control",
            )
        mode = dashboard.ask("robotmode")
        if "RUNNING" not in mode.upper():
            raise DeviceError(
                f"the robot at {options.host} is not running: {mode}",
                fix="power it on and release the brakes at the pendant",
            )
        safety = dashboard.ask("safetystatus")
        if "NORMAL" not in safety.upper():
            raise DeviceError(
                f"the robot at {options.host} is stopped: {safety}",
                fix="look at the arm and clear the stop at the pendant; vrbench never does",
            )
    finally:
        dashboard.close()


def findings(arm: Arm, options: Options) -> Iterator[Finding]:
    """What `vrbench rig check` finds; nothing is moved and no program is started."""
    try:
        check_controller(arm, options)
        yield Finding(True, f"{arm.name} answers at {options.host}, in remote control")
    except (ConfigError, DeviceError) as error:
        yield Finding(False, error.what, error.fix or "")
        return
    try:
        reader = Reader(options.host, options.rate_hz, time.monotonic_ns, options.timeout_s)
    except DeviceError as error:
        yield Finding(False, error.what, error.fix or "")
        return
    with reader:
        version = ".".join(str(part) for part in reader.version[:3])
        yield Finding(
            reader.version[0] >= E_SERIES, f"PolyScope {version}", "PolyScope 5 is needed"
        )
        time.sleep(0.3)
        times, packets = reader.take()
        yield Finding(
            len(times) > 1,
            f"{len(times)} samples in 0.3 s at {options.rate_hz:g} Hz",
            "use a cable",
        )
        yield _kinematics(arm, options, packets)
        if len(packets):
            bits = int(packets[-1]["safety_status_bits"])
            yield Finding(bits == 1, "safety: normal" if bits == 1 else safety_text(bits))
            speed = float(packets[-1]["target_speed_fraction"])
            yield Finding(speed > 0.999, f"speed slider at {100 * speed:.0f} %", "set it to 100 %")


def _kinematics(arm: Arm, options: Options, packets: Any) -> Finding:
    """How far the controller's own arm is from the one that plans are made for."""
    own = read_kinematics(options.host, options.timeout_s)
    if own is None or not len(packets):
        return Finding(True, "the controller does not tell its own kinematics")
    planned = read_calibration(options.calibration, arm) if options.calibration else arm.dh
    q = np.array(packets[-1]["actual_q"], dtype=np.float64)[None]
    off = difference(q, planned, own)
    where = "the rig's calibration" if options.calibration else "nominal kinematics"
    return Finding(
        off.max_mm < MOST_OFF_MM,
        f"its own kinematics put the flange {off.max_mm:.2f} mm from where {where} do, here",
        "give its calibration.conf in the rig"
        if not options.calibration
        else "another arm's file?",
    )
