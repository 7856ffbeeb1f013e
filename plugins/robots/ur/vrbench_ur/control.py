"""The parent's side of the child that moves the arm: orders, progress, and faults that stay."""

from __future__ import annotations

import contextlib
import json
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Generator
from typing import Any, Self

import numpy as np

from vrbench.geometry import Floats
from vrbench_ur.arms import Arm
from vrbench_ur.options import Options
from vrbench_ur.safety import RobotFaultError, approach, check_measured
from vrbench_ur.spline import JointPath

# Waiting for the child, which itself waits for the controller [s].
CONNECT_S, STOP_S = 15.0, 3.0
# A child that says nothing for this long is taken for dead [s].
SILENT_S = 5.0
POLL_S = 0.01
# How the arm lags behind servoJ's commands besides its lookahead: joints and a tick [s].
OWN_LAG_S = 0.006


class Control:
    """A child process that moves one arm.

    After a fault nothing moves any more: every call raises what happened, until a person has looked
    and vrbench is started again.

    Args:
        arm: the arm.
        options: of the rig.

    Raises:
        RobotFaultError: the child can't connect, or the controller doesn't take the settings.
    """

    def __init__(self, arm: Arm, options: Options) -> None:
        self.arm, self.options = arm, options
        self.fault: str | None = None
        self.last: dict[str, Any] = {}
        told = {
            "host": options.host,
            "arm": arm.name,
            "kg": options.payload.kg,
            "cog_m": list(options.payload.cog_m),
            "tcp": list(options.tcp),
            "timeout_s": options.timeout_s,
            "lookahead_s": options.lookahead_s,
            "gain": options.gain,
            "watchdog_hz": options.watchdog_hz,
            "stale_s": options.stale_s,
            "behind_s": options.behind_s,
            "max_error_rad": float(np.radians(options.max_error_deg)),
        }
        self._process = subprocess.Popen(
            [sys.executable, "-m", "vrbench_ur.servo", json.dumps(told)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._lines: queue.Queue[dict[str, Any] | None] = queue.Queue()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()
        ready = self._wait(CONNECT_S)
        self.q = np.array(ready["q"])

    def check(self) -> None:
        """Raises what happened, where something did.

        Raises:
            RobotFaultError: a fault stands.
        """
        if self.fault is not None:
            raise self._failed(self.fault)

    @property
    def pid(self) -> int:
        """The child's process id."""
        return self._process.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _listen(self) -> None:
        """Passes the child's lines on; None when there will be no more."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with contextlib.suppress(ValueError):
                self._lines.put(json.loads(line))
        self._lines.put(None)

    def _failed(self, why: str) -> RobotFaultError:
        self.fault = self.fault or why
        self._end()
        return RobotFaultError(
            f"{self.arm.name} at {self.options.host}: {self.fault}",
            fix="nothing moves again by itself; look at the arm, then start again",
        )

    def _take(self, wait_s: float) -> dict[str, Any] | None:
        """The child's next line, if one comes in time.

        Raises:
            RobotFaultError: it tells of a fault, or it died.
        """
        self.check()
        try:
            line = self._lines.get(timeout=wait_s)
        except queue.Empty:
            return None
        if line is None:
            code = self._process.wait(STOP_S)
            raise self._failed(f"the process that moves it ended by itself ({code})")
        if line["event"] == "fault":
            raise self._failed(str(line["why"]))
        if line["event"] == "stopped":
            raise self._failed("the motion was stopped")
        return line

    def _wait(self, seconds: float) -> dict[str, Any]:
        line = self._take(seconds)
        if line is None:
            raise self._failed(f"no answer within {seconds:g} s")
        return line

    def _send(self, **order: Any) -> None:
        self.check()
        assert self._process.stdin is not None
        try:
            self._process.stdin.write((json.dumps(order) + "\n").encode())
            self._process.stdin.flush()
        except OSError:
            while self._take(STOP_S) is not None:
                pass
            raise self._failed("the process that moves it is gone") from None

    def _done(self) -> Generator[float]:
        """Progress until the child is done; whoever leaves early stops the arm."""
        finished, heard = False, time.monotonic()
        try:
            while True:
                line = self._take(POLL_S)
                if line is None:
                    if time.monotonic() - heard > SILENT_S:
                        raise self._failed("the process that moves it says nothing")
                    yield self.last.get("done", 0.0)
                    continue
                heard = time.monotonic()
                self.last = line
                if line["event"] == "done":
                    finished = True
                    self.q = np.array(line["q"])
                    return
                yield line.get("done", 0.0)
        finally:
            if not finished:
                self.stop()

    def approach(self, goal: Floats) -> Generator[float]:
        """A slow move to joints (6,) [rad]; yields the part done.

        Raises:
            ConfigError: it would take longer than a move may.
            RobotFaultError: it was stopped.
        """
        plan = approach(self.arm, self.q, goal)
        self._send(do="approach", q=goal.tolist(), speed=plan.speed, duration_s=plan.duration_s)
        yield from self._done()

    def servo(self, path: JointPath, speed: float = 1.0) -> Generator[float]:
        """Replays a path from where the arm stands; yields the part done.

        Args:
            path: its first point must be where the arm is.
            speed: share of the path's own speed.

        Raises:
            DeviceError: the arm is not where the path starts.
            RobotFaultError: the arm stopped, or had to be stopped.
        """
        tolerance = float(np.radians(self.options.tolerance_deg))
        check_measured(self.arm, self.q, path.at(np.zeros(1))[0], tolerance)
        self._send(
            do="servo",
            knots=path.knots.tolist(),
            coefficients=path.coefficients.tolist(),
            speed=speed,
            lead_s=self.options.lookahead_s + OWN_LAG_S,
        )
        yield from self._done()

    def stop(self) -> None:
        """Stops the arm; nothing can be moved afterwards."""
        self.fault = self.fault or "the motion was stopped"
        self._end()

    def close(self) -> None:
        """Releases the arm and ends the child."""
        self.fault = self.fault or "the connection was closed"
        self._end()

    def _end(self) -> None:
        """Closing its input stops the child, and with it the arm; else the child is killed."""
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            # the controller's watchdog stops the arm
            self._process.kill()
            self._process.wait()
        if threading.current_thread() is not self._listener:
            self._listener.join(STOP_S)
        if self._process.stdout is not None:
            self._process.stdout.close()
