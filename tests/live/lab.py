"""A rig of emulated devices, each a process of its own, and a person at a terminal who types."""

from __future__ import annotations

import contextlib
import ctypes
import os
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from vrbench.config.rig import load_rig
from vrbench.config.suite import load_suite
from vrbench.motion.files import Header, write_motion
from vrbench.motion.generators import REACH, saturating
from vrbench.plugin.manager import Plugins
from vrbench.running.permission import Planned, plan_suite

SECONDS = 16.0
TOKEN = "0123456789abcdef"
PATIENCE_S = 120.0

SUITE = """
suite: live
version: 1
title: As short as it can be
references: [robot, mocap]
motions: {head: turns.tum, opening: opening.tum, calibration: turns.tum}
cases:
  - {id: calibrate, motion: calibration, role: calibration, anchor: 2 s}
  - id: replay
    motion: head
    loops: 2
    exclude: [opening, gap]
    needs: [x, clock, y]
metrics: [ape, scale, coverage, timing, clock, handeye]
gate: {handeye.translation: 30 mm, handeye.rotation: 2 deg, max_age: 60 min, bracket: 20 mm}
rank: {metric: ape.translation.aligned, point: eye, statistic: rmse, min_coverage: 90 %}
"""

# A computer that others load is borne with: nothing moves here that could be hurt.
RIG = """
lab: emulated
headset:
  plugin: {route}
  device: quest-2
  options: {{listen: "127.0.0.1:{page}", token: {token}, wait_s: 60, quiet: true{more}}}
mocap:
  plugin: optitrack
  options: {{server: 127.0.0.1, interface: 127.0.0.1, body: headset, command_port: {motive}}}
  accuracy: {{value: 0.2 mm, source: emulated}}
robot:
  plugin: ur5e
  options:
    host: {host}
    start: {start}
    first_pass_percent: 100
    rate_hz: 125
    watchdog_hz: 0.2
    stale_s: 4.0
    timeout_s: 4.0
    behind_s: 60
    max_error_deg: 30
  accuracy: {{value: 0.1 mm, source: emulated}}
"""

# What the terminal asks for: leave to move by a plan, or something done to the headset.
PROMPT = re.compile(r"Type ([0-9a-f]{12}) to let it move|([^\n]{0,200})\. Enter goes on ")
TAIL = 4000
# Where the arm can do `turns.tum`.
START = "{p_m: [0.694, 0.0068, 0.8427], yaw_deg: -57}"
# The options that a headset's route has of its own.
ROUTES = {"webxr": "", "quest": ", adb: false"}
PDEATHSIG = 1


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def taken(port: int) -> bool:
    """Whether something listens there by UDP."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return True
    return False


def ends_with_its_parent() -> None:
    """For a child, before it begins: whatever ends its parent kills it, stopped or not (Linux)."""
    ctypes.CDLL(None).prctl(PDEATHSIG, signal.SIGKILL)


class Typed:
    """A command at a terminal of its own, and a person who does there what is asked for.

    The robot is allowed to move whenever it is asked for.

    Args:
        words: of the command.
        hands: told what a prompt wants done to the headset, before Enter is pressed.

    Attributes:
        shown: all that the terminal has shown so far.
        asked: how often leave to move was asked for.
    """

    def __init__(self, *words: object, hands: Callable[[str], None] = lambda _: None) -> None:
        self.terminal, other = pty.openpty()
        self.shown, self.asked = "", 0
        self._hands, self._answered = hands, 0
        self.process = subprocess.Popen(
            [sys.executable, "-m", "vrbench", *map(str, words)],
            stdin=other,
            stdout=other,
            stderr=other,
            start_new_session=True,
            preexec_fn=ends_with_its_parent,
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
            self._answer()
        return True

    def _answer(self) -> None:
        """Does what the terminal asks for, once."""
        tail = self.shown[max(self._answered, len(self.shown) - TAIL) :]
        for found in PROMPT.finditer(tail):
            self._answered = len(self.shown)
            plan, wanted = found.groups()
            if plan is not None:
                self.asked += 1
            else:
                self._hands(wanted)
            os.write(self.terminal, f"{plan or ''}\n".encode())

    def until(self, pattern: str) -> None:
        """Goes on until the terminal shows something."""
        end = time.monotonic() + PATIENCE_S
        seen = len(self.shown)
        while not re.search(pattern, self.shown[seen:]):
            assert time.monotonic() < end, f"{pattern} never came:\n{self.shown[-3000:]}"
            assert self.read(0.1), f"it ended before {pattern} came:\n{self.shown[-3000:]}"

    def end(self, patience_s: float = PATIENCE_S) -> int:
        """Goes on to the end; the exit code."""
        end = time.monotonic() + patience_s
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

    Args:
        folder: where it is written.
        suite: that is run there, by its path; None for one as short as can be.
        start: where the arm's motions begin, as YAML.

    Attributes:
        arm: the robot, told what to do by `tell`.
        hash: of the plans of the suite.
    """

    def __init__(self, folder: Path, suite: Path | None = None, start: str = START) -> None:
        from vrbench_ur.plan import start_posture
        from vrbench_ur.testing import Emulator

        self.folder = folder
        # not on a disk: what is written to one waits for others
        shm = Path("/dev/shm")
        self._stage = (shm if shm.is_dir() else folder) / f"vrbench-test-{os.getpid()}"
        self.arm = Emulator("--stage", str(self._stage))
        self._port, self._page = free_port(), free_port()
        self.motive: subprocess.Popen | None = None
        self.headset: subprocess.Popen | None = None
        self._route = ""
        write_motions(folder)
        self.suite = suite or folder / "suite.yaml"
        if suite is None:
            self.suite.write_text(SUITE)
        self.rigs = {}
        for route, more in ROUTES.items():
            told = {"route": route, "more": more, "token": TOKEN, "page": self._page}
            told |= {"motive": self._port, "host": self.arm.host, "start": start}
            self.rigs[route] = folder / f"{route}.yaml"
            self.rigs[route].write_text(RIG.format(**told))
        planned = self._planned(self.suite)
        self.hash = planned.hash
        self.posture = start_posture(next(iter(planned.plans.values())))

    def _planned(self, suite: Path) -> Planned:
        rig = str(self.rigs["webxr"])
        planned = plan_suite(load_suite(str(suite)), load_rig(rig), rig, Plugins(), lambda *_: None)
        assert planned is not None
        return planned

    def ready(self, route: str = "webxr") -> None:
        """All emulators run, and the arm is near where the motion starts."""
        self.arm.tell("clear")
        self.arm.place(self.posture + 0.01)
        if self.motive is None or self.motive.poll() is not None:
            end(self.motive)
            words = ("--command-port", str(self._port), "--data-port", "0", "--rate", "100")
            self.motive = self._start("vrbench_optitrack.emulator", *words)
            # vrbench asks Motive once, and a busy computer takes seconds to start an emulator
            until = time.monotonic() + PATIENCE_S
            while not taken(self._port):
                assert time.monotonic() < until, "the emulated Motive doesn't listen"
                time.sleep(0.1)
        if self.headset is None or self.headset.poll() is not None or route != self._route:
            end(self.headset)
            self.headset, self._route = self._start(*self._headset(route)), route

    def _headset(self, route: str) -> tuple[str, ...]:
        """The emulator of a headset, and what it is told."""
        words = ("--rate", "72", "--hands")
        if route == "quest":
            address = ("--port", str(self._page), "--token", TOKEN)
            return ("vrbench_quest.emulator", *address, *words)
        url = f"http://127.0.0.1:{self._page}/{TOKEN}/"
        return ("vrbench_webxr.emulator", url, *words)

    def _start(self, module: str, *words: str) -> subprocess.Popen:
        return subprocess.Popen(
            [sys.executable, "-m", module, *words, "--stage", str(self._stage)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            preexec_fn=ends_with_its_parent,
        )

    @contextlib.contextmanager
    def vrbench(
        self,
        verb: str,
        run: Path,
        *more: str,
        route: str = "webxr",
        suite: Path | None = None,
    ):
        """`vrbench run` or `record` at a terminal, of the lab's suite or another."""
        self.ready(route)
        rig = self.rigs[route]
        plans = self.hash if suite is None else self._planned(suite).hash
        words = (verb, suite or self.suite, "--rig", rig, "-o", run, "--execute", plans)
        typed = Typed(*words, *more, hands=self.hands)
        try:
            yield typed
        finally:
            typed.close()

    def hands(self, prompt: str) -> None:
        """Does to the headset what a prompt asks for."""
        if "anew" in prompt:
            line = "remount"
        elif "Uncover all" in prompt:
            line = "uncover"
        elif "Cover all" in prompt:
            line = "cover 1"
        else:  # of four cameras
            line = f"cover {len(re.findall(r'[0-9]+ [(]', prompt)) / 4:g}"
        assert self.headset is not None and self.headset.stdin is not None
        self.headset.stdin.write(f"{line}\n".encode())
        self.headset.stdin.flush()

    def moving(self) -> bool:
        return self.arm.report()["moving"]

    def end_emulators(self) -> None:
        """Headset and motion capture end, whatever was done to them; `ready` starts others."""
        for process in (self.motive, self.headset):
            end(process)

    def close(self) -> None:
        self.end_emulators()
        self.arm.close()
        self._stage.unlink(missing_ok=True)


def write_motions(folder: Path) -> None:
    """Those of the shortest suite, about and along all axes; what opens a loop isn't like it."""
    for name, slower in (("turns", 1.0), ("opening", 1.2)):
        header = Header(motion=name, version=1, up="y", rate_hz=120, source="generated")
        made = saturating(name, "All axes", SECONDS / slower**2, REACH / slower, slower)
        write_motion(folder / f"{name}.tum", header, made.trajectory)


def end(process: subprocess.Popen | None) -> None:
    """Ends a process if there is one, a stopped one too."""
    if process is None:
        return
    process.kill()
    process.wait()
    if process.stdin is not None:
        process.stdin.close()
