"""The child process that holds the connection which moves the arm: `python -m vrbench_ur.servo`.

ur-rtde lives here alone: a lost connection crashes the process that holds it, and left to itself
it would connect again and repeat the last motion. So this process ends instead, at the first sign
of trouble, and the controller's watchdog stops the arm. It takes orders as lines of JSON on
standard input and stops the arm when that closes, for then its parent is dead.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import sys
import threading
import time
from collections import deque
from types import FrameType
from typing import Any

import numpy as np

from vrbench.errors import VrbenchError
from vrbench.geometry import Floats
from vrbench_ur.arms import ARMS
from vrbench_ur.reader import Reader
from vrbench_ur.safety import APPROACH_ACCELERATION, clamp
from vrbench_ur.spline import JointPath
from vrbench_ur.watching import FaultError, check_packet, off_track

PERIOD_S = 0.002
WATCH_HZ = 125.0
STOP_SERVO, STOP_JOINTS = 10.0, 2.0
# The lead that makes up for the lag grows over this long, so that nothing jerks [s].
EASE_S = 0.5
# Commands that a measured posture is compared with: those of the last 0.2 s.
REMEMBERED = 100
SETTLE_S = 0.4
TOLD_HZ = 25.0
LEAVE_FAULT = 3


class _Stopped(Exception):  # noqa: N818 - not an error: somebody asked for it
    """Somebody wants the arm to stop."""


def say(**what: Any) -> None:
    """A line to the parent; a parent that is gone is found out elsewhere."""
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.write(json.dumps(what) + "\n")
        sys.stdout.flush()


class Child:
    """Moves one arm as it is told, and watches it.

    Args:
        told: the parent's settings: host, arm, payload, tcp, limits of the loop.
    """

    def __init__(self, told: dict[str, Any]) -> None:
        self.told, self.arm = told, ARMS[told["arm"]]
        self._stop = threading.Event()
        self._orders: deque[dict[str, Any]] = deque()
        self._typed = b""
        self._parent = os.getppid()
        self._moving = self._guarded = False
        self.control: Any = None
        self.reader: Reader

    def signalled(self, _number: int, _frame: FrameType | None) -> None:
        """Ctrl-C at the terminal reaches this process too."""
        self._stop.set()

    def run(self) -> int:
        """Connects, then does what it is told until its parent ends or something goes wrong."""
        told = self.told
        self.reader = Reader(told["host"], WATCH_HZ, time.monotonic_ns, told["timeout_s"])
        threading.Thread(target=self._watch, daemon=True).start()
        import rtde_control

        self.control = rtde_control.RTDEControlInterface(told["host"], 1.0 / PERIOD_S)
        try:
            self._set_up()
            say(event="ready", q=self._q().tolist())
            while True:
                self._order(self._next())
        except _Stopped:
            self._halt()
            say(event="stopped")
            return 0
        except FaultError as fault:
            self._halt()
            say(event="fault", why=str(fault))
            return LEAVE_FAULT

    # -- orders

    def _poll(self, wait_s: float = 0.0) -> None:
        """Reads orders that have come in; raises where the arm is to stop."""
        if self._stop.is_set() or os.getppid() != self._parent:
            raise _Stopped
        ready, _, _ = select.select([0], [], [], wait_s)
        if not ready:
            return
        data = os.read(0, 1 << 20)
        if not data:
            raise _Stopped
        *lines, self._typed = (self._typed + data).split(b"\n")
        for line in lines:
            order = json.loads(line)
            if order["do"] == "stop":
                raise _Stopped
            self._orders.append(order)

    def _next(self) -> dict[str, Any]:
        while not self._orders:
            self._poll(0.02)
            self._check_state(idle=True)
            if self._guarded:
                self.control.kickWatchdog()
        return self._orders.popleft()

    def _order(self, order: dict[str, Any]) -> None:
        if order["do"] == "approach":
            self._approach(np.array(order["q"]), order["speed"], order["duration_s"])
        elif order["do"] == "servo":
            path = JointPath(np.array(order["knots"]), np.array(order["coefficients"]))
            self._servo(path, order["speed"], order["lead_s"])

    # -- what is watched

    def _watch(self) -> None:
        """Ends the process where the arm's time stands still: ur-rtde must never reconnect."""
        stale_s = float(self.told["stale_s"])
        seen, since = -1.0, time.monotonic()
        while True:
            time.sleep(0.01)
            packet = self.reader.latest()
            now = time.monotonic()
            stamp = -1.0 if packet is None else float(packet["timestamp"])
            if stamp != seen:
                seen, since = stamp, now
            elif now - since > stale_s or self.reader.lost is not None:
                still = f"the controller's time stands still for {stale_s:g} s"
                why = self.reader.lost or still
                say(event="fault", why=f"connection lost: {why}; its watchdog stops the arm")
                os._exit(LEAVE_FAULT)

    def _packet(self) -> Any:
        """The newest packet; the first is waited for."""
        deadline = time.monotonic() + self.told["timeout_s"]
        while (packet := self.reader.latest()) is None:
            if time.monotonic() > deadline:
                raise FaultError("the controller has sent nothing yet")
            time.sleep(0.005)
        self.reader.take()
        return packet

    def _q(self) -> Floats:
        return np.array(self._packet()["actual_q"], dtype=np.float64)

    def _check_state(self, *, idle: bool = False) -> Any:
        """The newest packet, if it says that all is well.

        Raises:
            FaultError: a stop, a program that ended, or a speed other than full.
        """
        packet = self._packet()
        check_packet(packet, full_speed=self._moving and not idle)
        return packet

    # -- moves

    def _set_up(self) -> None:
        """Payload and TCP, read back; and the watchdog."""
        told, control = self.told, self.control
        if not control.setPayload(told["kg"], told["cog_m"]):
            raise FaultError("the controller did not take the payload")
        if not control.setTcp(told["tcp"]):
            raise FaultError("the controller did not take the TCP")
        back = np.array(control.getTCPOffset())
        if np.abs(back - told["tcp"]).max() > 1e-6:
            raise FaultError(f"the TCP reads back as {np.round(back, 6).tolist()}")
        deadline = time.monotonic() + told["timeout_s"]
        while abs(float(self._packet()["payload"]) - told["kg"]) > 1e-6:
            if time.monotonic() > deadline:
                raise FaultError(
                    f"the payload reads back as {float(self._packet()['payload']):g} kg"
                )
            time.sleep(0.01)

    def _guard(self) -> None:
        if not self.control.setWatchdog(self.told["watchdog_hz"]):
            raise FaultError("the controller did not take the watchdog")
        self._guarded = True

    def _approach(self, goal: Floats, speed: float, duration_s: float) -> None:
        """A slow move to where a plan starts, that can be stopped at any time."""
        self._guard()
        if not self.control.moveJ(goal.tolist(), speed, APPROACH_ACCELERATION, True):
            raise FaultError("the controller refused the approach")
        self._moving = True
        begin = time.monotonic()
        start = self._q()
        far = max(float(np.abs(goal - start).max()), 1e-9)
        told = 0.0
        while True:
            self._poll(0.02)
            packet = self._check_state()
            self.control.kickWatchdog()
            off = float(np.abs(goal - packet["actual_q"]).max())
            if off < 2e-3 and np.abs(packet["target_qd"]).max() < 1e-3:
                break
            spent = time.monotonic() - begin
            if spent > 2.0 * duration_s + 10.0:
                raise FaultError(
                    f"the approach does not arrive: {np.degrees(off):.2f} deg are left"
                )
            if spent - told > 1.0 / TOLD_HZ:
                told = spent
                say(event="at", done=1.0 - min(off / far, 1.0))
        self._moving = False
        say(event="done", q=self._q().tolist())

    def _servo(self, path: JointPath, speed: float, lead_s: float) -> None:
        """Replays a path by servoJ, `lead_s` ahead of the clock to make up for the arm's lag."""
        told, control = self.told, self.control
        duration = path.duration_s / speed
        follow = told["lookahead_s"], told["gain"]
        table = path.at(np.arange(0.0, path.duration_s + PERIOD_S * speed, PERIOD_S * speed))
        last = table[0].copy()
        sent: deque[Floats] = deque([last], maxlen=REMEMBERED)
        self._guard()
        self._moving = True
        worst = 0.0
        periods: list[float] = []
        begin = previous = time.monotonic()
        at = slip = 0.0
        step = PERIOD_S
        reported = -1.0
        say(event="begin", t=time.time_ns())
        while at < duration + SETTLE_S:
            self._poll()
            packet = self._check_state()
            ahead = at + lead_s * min(at / EASE_S, 1.0)
            place = min(ahead / PERIOD_S, len(table) - 1.0)
            k = min(int(place), len(table) - 2)
            goal = table[k] + (place - k) * (table[k + 1] - table[k])
            goal, cut = clamp(goal, last, self.arm.speed, step)
            if cut:
                raise FaultError(f"a command at {at:.3f} s is too far from the one before")
            if not control.servoJ(goal.tolist(), 0.0, 0.0, PERIOD_S, *follow):
                self._explain()
                raise FaultError("the controller refused a servoJ")
            last = goal
            sent.append(goal)
            error = off_track(packet, sent, told["max_error_rad"], at)
            worst = max(worst, error)
            if at - reported > 1.0 / TOLD_HZ:
                reported = at
                say(event="at", done=min(at / duration, 1.0))
            # the path never jumps ahead to catch up: what the loop misses it falls behind
            now = time.monotonic()
            if now < previous + PERIOD_S:
                time.sleep(previous + PERIOD_S - now)
                now = time.monotonic()
            periods.append(now - previous)
            slip += max(0.0, now - previous - 2 * PERIOD_S)
            # after a loop that was late the path is farther on, and so is the next command
            step = min(now - previous, 2 * PERIOD_S)
            at += step
            previous = now
            if slip > told["behind_s"]:
                raise FaultError(f"this computer is too busy: the replay is {slip:.2f} s behind")
        if not control.servoStop(STOP_SERVO):
            raise FaultError("the controller did not end the replay")
        self._moving = False
        say(
            event="done",
            q=self._q().tolist(),
            seconds=time.monotonic() - begin,
            slip_ms=1e3 * slip,
            period_p99_ms=1e3 * float(np.percentile(periods, 99)),
            error_deg=float(np.degrees(worst)),
        )

    def _explain(self) -> None:
        """Waits for the packet that says why the controller refuses.

        Raises:
            FaultError: it came.
        """
        deadline = time.monotonic() + self.told["stale_s"]
        while time.monotonic() < deadline:
            self._check_state()
            time.sleep(0.005)

    def blame(self, error: Exception) -> str:
        """Stops the arm where it can still be told to, and says what went wrong."""
        time.sleep(0.05)
        lost = getattr(getattr(self, "reader", None), "lost", None)
        if lost is not None:
            return f"connection lost: {lost}; its watchdog stops the arm"
        self._halt()
        return f"{type(error).__name__}: {error}"

    def _halt(self) -> None:
        """Stops the arm, if it moves, and the program, so that nothing can move it again."""
        if self.control is None:
            return
        with contextlib.suppress(Exception):
            if self._moving:
                self.control.servoStop(STOP_SERVO)
                self.control.stopJ(STOP_JOINTS)
        with contextlib.suppress(Exception):
            self.control.stopScript()


def main() -> int:
    """The child's whole life; its settings are its only argument, as JSON."""
    child = Child(json.loads(sys.argv[1]))
    # a loop of 2 ms wants to be woken in time; where that isn't allowed it does without
    with contextlib.suppress(OSError):
        os.nice(-10)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, child.signalled)
    try:
        code = child.run()
    except VrbenchError as error:
        say(event="fault", why=str(error))
        code = LEAVE_FAULT
    except Exception as error:  # whatever ur-rtde throws is the robot's trouble, told in one line
        say(event="fault", why=child.blame(error))
        code = LEAVE_FAULT
    # without its destructors: they wait, and talk to a controller that may be gone
    sys.stdout.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
