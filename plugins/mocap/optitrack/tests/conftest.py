"""Emulated Motives, each a process of its own, and a host clock whose truth is known."""

import json
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
from vrbench_optitrack.behaviour import ServerClock
from vrbench_optitrack.options import Options

from vrbench.devices.ports import Session
from vrbench.geometry import Transform


class MonotonicClock:
    """The emulator's own reference, so that a test can tell what the truth is."""

    def now(self):
        return time.monotonic_ns()

    def wait(self, seconds):
        time.sleep(seconds)


@pytest.fixture
def session():
    return Session(MonotonicClock(), Transform.identity(), 1)


@pytest.fixture
def motive():
    """Starts emulators by their arguments; none outlives its test."""
    running = []

    def start(*arguments):
        command = [sys.executable, "-m", "vrbench_optitrack.emulator", "--duration", "30"]
        command += ["--command-port", "0", "--data-port", "0", "--motion", "saturate-30s-1"]
        process = subprocess.Popen(
            [*command, "--begin", "10", *map(str, arguments)], stdout=subprocess.PIPE, text=True
        )
        running.append(process)
        said = json.loads(process.stdout.readline())
        return SimpleNamespace(
            port=said["command_port"],
            data_port=said["data_port"],
            first_frame_ns=said["first_frame_ns"],
            clock=ServerClock(**said["clock"]),
            stop=process.terminate,
        )

    yield start
    for process in running:
        process.terminate()
        process.communicate(timeout=10)


@pytest.fixture
def options():
    """Options for an emulator."""

    def make(motive, **more):
        return Options(
            **{"body": "headset", "server": "127.0.0.1", "command_port": motive.port, **more}
        )

    return make
