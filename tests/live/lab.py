"""A rig of emulated devices, each a process of its own, and a person at a terminal who types."""

from __future__ import annotations

import contextlib
import os
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from vrbench.config.rig import load_rig
from vrbench.config.suite import load_suite
from vrbench.motion.files import Header, write_motion
from vrbench.motion.generators import saturating
from vrbench.plugin.manager import Plugins
from vrbench.running.permission import plan_suite

SECONDS = 16.0
TOKEN = "0123456789abcdef"
PATIENCE_S = 120.0

SUITE = """
suite: live
version: 1
title: As short as it can be
references: [robot, mocap]
motions: {head: turns.tum, calibration: turns.tum}
cases:
  - {id: calibrate, motion: calibration, role: calibration}
  - {id: replay, motion: head, needs: [x, clock, y], anchor: 2 s}
metrics: [ape, scale, coverage, timing, clock, handeye]
gate: {handeye.translation: 30 mm, handeye.rotation: 2 deg, max_age: 60 min, bracket: 20 mm}
rank: {metric: ape.translation.aligned, point: eye, statistic: rmse, min_coverage: 90 %}
"""

# A computer that others load is borne with: nothing moves here that could be hurt.
RIG = """
lab: emulated
headset:
  plugin: webxr
  device: quest-2
  options: {{listen: "127.0.0.1:{page}", token: {token}, wait_s: 60, quiet: true}}
mocap:
  plugin: optitrack
  options: {{server: 127.0.0.1, interface: 127.0.0.1, body: headset, command_port: {motive}}}
  accuracy: {{value: 0.2 mm, source: emulated}}
robot:
  plugin: ur5e
  options:
    host: {host}
    start: {{p_m: [0.694, 0.0068, 0.8427], yaw_deg: -57}}
    first_pass_percent: 100
    rate_hz: 125
    watchdog_hz: 0.2
    stale_s: 4.0
    timeout_s: 4.0
    behind_s: 60
    max_error_deg: 30
  accuracy: {{value: 0.1 mm, source: emulated}}
"""


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


class Typed:
    """A command at a terminal of its own; the robot is allowed to move whenever it is asked for.

    Attributes:
        shown: all that the terminal has shown so far.
        asked: how often leave to move was asked for.
    """

    def __init__(self, *words: object) -> None:
        self.terminal, other = pty.openpty()
        self.shown, self.asked = "", 0
        self.process = subprocess.Popen(
            [sys.executable, "-m", "vrbench", *map(str, words)],
            stdin=other,
            stdout=other,
            stderr=other,
            start_new_session=True,
            env={**os.environ, "COLUMNS": "80"},
        )
        os.close(other)

    def read(self, seconds: float) -> bool:
        """Shows and types for so long; whether it goes on."""
        ready, _, _ = select.select([self.terminal], [], [], seconds)
        if ready:
            try:
                data = os.read(self.terminal, 65536)
            except OSError:  # the other end is closed
                data = b""
            if not data:
                return False
            self.shown += data.decode(errors="replace")
            questions = re.findall(r"Type ([0-9a-f]{12}) to let it move", self.shown)
            if len(questions) > self.asked:
                self.asked = len(questions)
                os.write(self.terminal, f"{questions[-1]}\n".encode())
        return True

    def until(self, pattern: str) -> None:
        """Goes on until the terminal shows something."""
        end = time.monotonic() + PATIENCE_S
        seen = len(self.shown)
        while not re.search(pattern, self.shown[seen:]):
            assert time.monotonic() < end, f"{pattern} never came:\n{self.shown[-3000:]}"
            assert self.read(0.1), f"it ended before {pattern} came:\n{self.shown[-3000:]}"

    def end(self) -> int:
        """Goes on to the end; the exit code."""
        end = time.monotonic() + PATIENCE_S
        while self.read(0.1):
            assert time.monotonic() < end, f"it doesn't end:\n{self.shown[-3000:]}"
        return self.process.wait(PATIENCE_S)

    def interrupt(self) -> None:
        """Ctrl-C, to all that run at this terminal."""
        os.killpg(self.process.pid, signal.SIGINT)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        os.close(self.terminal)


class Lab:
    """Emulated devices, as a lab would run them, and what a lab writes.

    Attributes:
        arm: the robot, told what to do by `tell`.
        hash: of the plans of the suite.
    """

    def __init__(self, folder: Path) -> None:
        from vrbench_ur.plan import start_posture
        from vrbench_ur.testing import Emulator

        self.folder = folder
        # not on a disk: what is written to one waits for others
        shm = Path("/dev/shm")
        self._stage = (shm if shm.is_dir() else folder) / f"vrbench-test-{os.getpid()}"
        self.arm = Emulator("--stage", str(self._stage))
        self._port, page = free_port(), free_port()
        self._url = f"http://127.0.0.1:{page}/{TOKEN}/"
        self.motive = self.headset = None
        write_motion(
            folder / "turns.tum",
            Header(motion="turns", version=1, up="y", rate_hz=120, source="generated"),
            saturating("turns", "All axes", SECONDS).trajectory,
        )
        self.suite, self.rig = folder / "suite.yaml", folder / "rig.yaml"
        self.suite.write_text(SUITE)
        told = RIG.format(page=page, token=TOKEN, motive=self._port, host=self.arm.host)
        self.rig.write_text(told)
        planned = plan_suite(
            load_suite(str(self.suite)),
            load_rig(str(self.rig)),
            str(self.rig),
            Plugins(),
            lambda *_: None,
        )
        self.hash = planned.hash
        (plan,) = planned.plans.values()
        self.posture = start_posture(plan)

    def ready(self) -> None:
        """All emulators run, and the arm is near where the motion starts."""
        self.arm.tell("clear")
        self.arm.place(self.posture + 0.01)
        stage = ("--stage", str(self._stage))
        if self.motive is None or self.motive.poll() is not None:
            words = ("--command-port", str(self._port), "--data-port", "0", "--rate", "100", *stage)
            self.motive = self._start("vrbench_optitrack.emulator", *words)
        if self.headset is None or self.headset.poll() is not None:
            self.headset = self._start("vrbench_webxr.emulator", self._url, "--rate", "72", *stage)

    def _start(self, module: str, *words: str) -> subprocess.Popen:
        return subprocess.Popen([sys.executable, "-m", module, *words], stdout=subprocess.DEVNULL)

    @contextlib.contextmanager
    def vrbench(self, verb: str, run: Path, *more: str):
        """`vrbench run` or `record` at a terminal."""
        self.ready()
        typed = Typed(verb, self.suite, "--rig", self.rig, "-o", run, "--execute", self.hash, *more)
        try:
            yield typed
        finally:
            typed.close()

    def moving(self) -> bool:
        return self.arm.report()["moving"]

    def close(self) -> None:
        for process in (self.motive, self.headset):
            if process is not None:
                process.kill()
                process.wait()
        self.arm.close()
        self._stage.unlink(missing_ok=True)
