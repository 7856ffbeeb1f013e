"""For tests of what uses a UR arm: an emulator in a process of its own, a rig, a small motion.

Public: a lab's own tests may use it. Each emulator has a loopback address of its own (Linux), for
the ports are fixed.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any, Self

import numpy as np

from vrbench.config.rig import Mounting
from vrbench.geometry import Floats, Transform, rotvec_to_quat
from vrbench.trajectory import NS, Trajectory
from vrbench_ur.options import Options, Start

_NUMBER = itertools.count(1)
# Ample for a machine that others load; nothing waits for as long when all is well.
PATIENCE_S = 20.0
START = Start(p_m=(0.4622, 0.0109, 0.9861), yaw_deg=155.84)
"""A good start of a UR5e, found by search for the motion `shooter-1`."""
STARTS = {
    "ur3e": Start(p_m=(0.2773, 0.0109, 0.5917), yaw_deg=155.84),
    "ur5e": START,
    "ur10e": Start(p_m=(0.6471, 0.0109, 1.3805), yaw_deg=155.84),
}
"""Starts from which each arm can do a small motion: the UR5e's, in proportion to its reach."""
MOUNTING = Mounting().tcp_eye.transform()
"""The nominal mounting of a rig that states none."""


def wait_until(what: Callable[[], Any], seconds: float = PATIENCE_S) -> Any:
    """The first true value of `what`.

    Raises:
        AssertionError: it doesn't become true in time.
    """
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        value = what()
        if value:
            return value
        time.sleep(0.01)
    raise AssertionError("waited in vain")


class Emulator:
    """`python -m vrbench_ur.emulator`, told what to do line by line.

    Attributes:
        host: its address.
    """

    def __init__(self, *arguments: str) -> None:
        pid = os.getpid()
        self.host = f"127.{100 + pid // 250 % 100}.{pid % 250 + 1}.{next(_NUMBER) % 250 + 1}"
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "vrbench_ur.emulator", "--host", self.host),
                *("--until-eof", "--quiet", *arguments),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        assert self._line().startswith("ready")

    def _line(self) -> str:
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE_S)
        assert ready, "the emulator says nothing"
        return self.process.stdout.readline().decode()

    def tell(self, line: str) -> None:
        """Sends a command: see `python -m vrbench_ur.emulator --help`."""
        assert self.process.stdin is not None
        self.process.stdin.write((line + "\n").encode())
        self.process.stdin.flush()

    def report(self) -> dict[str, Any]:
        """The emulator's state: tick, joints, safety, events ..."""
        self.tell("report")
        told: dict[str, Any] = json.loads(self._line())
        return told

    def ticks(self, what: str) -> list[int]:
        """Ticks of the events of this name."""
        return [tick for tick, event in self.report()["events"] if event.startswith(what)]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def place(self, q: Floats) -> None:
        """Puts the arm at joints (6,) [rad] at once."""
        self.tell("place " + " ".join(repr(float(x)) for x in q))

    def close(self) -> None:
        """Ends the process."""
        with contextlib.suppress(OSError):
            assert self.process.stdin is not None
            self.process.stdin.close()
        try:
            self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


def options(host: str = "127.0.0.1", **changes: Any) -> Options:
    """A rig that bears with a loaded machine: nothing in a test moves that could be hurt."""
    told: dict[str, Any] = {
        "host": host,
        "start": START,
        "watchdog_hz": 0.5,
        "stale_s": 1.0,
        "behind_s": 60.0,
        "max_error_deg": 6.0,
        "rate_hz": 125.0,
        "first_pass_percent": 100.0,
    }
    return Options.model_validate(told | changes)


def nod(seconds: float = 3.0, *, size: float = 1.0, still: bool = True) -> Trajectory:
    """A small motion of the head; at rest at its ends, unless `still` is false."""
    t = np.arange(round(seconds * 120) + 1) / 120.0
    ease = np.sin(np.pi * np.clip(t / seconds, 0, 1)) ** 2 if still else np.ones_like(t)
    wave = np.sin(2 * np.pi * 0.5 * t) * size
    p = ease[:, None] * wave[:, None] * np.array([0.05, 0.02, 0.03])
    turn = ease[:, None] * wave[:, None] * np.radians([8.0, 12.0, 4.0])
    poses = Transform(p, rotvec_to_quat(turn))
    first = poses[0].inverse()
    return Trajectory(np.rint(t * NS).astype(np.int64), first @ poses)
