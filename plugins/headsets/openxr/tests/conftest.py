"""A made-up runtime: pyopenxr's own types, and functions that tell of a head on a known path."""

import ctypes
import threading
from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest

from vrbench.geometry import rotvec_to_quat

# The runtime's clock is no clock of the system's.
XR_AHEAD_NS = 123_456_789_012_345


def _path(t_ns):
    """Where the head is at a time of the system's clock: x y z qx qy qz qw."""
    t = (t_ns % 10**12) / 1e9
    p = (0.2 * np.sin(1.1 * t), 1.5 + 0.05 * np.sin(1.7 * t), 0.1 * np.sin(0.9 * t))
    q = rotvec_to_quat(np.array([0.3 * np.sin(1.3 * t), 0.6 * np.sin(0.7 * t), 0.1]))
    return (*p, *q)


class FakeRuntime:
    """What the tests do to the runtime.

    Attributes:
        flags: of all locations.
        offered: extensions.
        events: to be polled; functions that make them.
        fails: an exception that the next location raises.
        alive: handles that are not destroyed yet.
    """

    def __init__(self, xr):
        self.xr = xr
        self.flags = 15
        self.offered = ["XR_MND_headless", "XR_KHR_convert_timespec_time", "XR_other"]
        self.events = deque()
        self.fails = None
        self.alive = set()
        self.begun = self.ended = 0
        self.thread = set()

    def state(self, name):
        event = self.xr.EventDataSessionStateChanged(state=self.xr.SessionState[name])
        self.events.append(event)

    def recentre(self, change_time, kind="LOCAL"):
        event = self.xr.EventDataReferenceSpaceChangePending(
            reference_space_type=self.xr.ReferenceSpaceType[kind], change_time=change_time
        )
        self.events.append(event)

    def module(self):
        xr = self.xr
        names = (
            "ApplicationInfo InstanceCreateInfo SystemGetInfo FormFactor SessionCreateInfo"
            " ReferenceSpaceType ReferenceSpaceCreateInfo SessionBeginInfo ViewConfigurationType"
            " SessionState StructureType EventUnavailable EventDataSessionStateChanged"
            " EventDataReferenceSpaceChangePending exception timespec"
        )
        made = SimpleNamespace(**{name: getattr(xr, name) for name in names.split()})
        made.enumerate_instance_extension_properties = lambda: [
            SimpleNamespace(extension_name=name.encode()) for name in self.offered
        ]
        made.create_instance = lambda info: self._made("instance")
        made.get_system = lambda instance, info: 7
        made.get_instance_properties = lambda instance: SimpleNamespace(
            runtime_name=b"Fake", runtime_version=xr.Version(1, 2, 3)
        )
        made.get_system_properties = lambda instance, system: SimpleNamespace(system_name=b"Head")
        made.create_session = lambda instance, info: self._made("session")
        made.create_reference_space = lambda session, info: self._made(
            f"space {info.reference_space_type.name}"
        )
        made.begin_session = self._begin
        made.end_session = self._end
        made.poll_event = self._poll
        made.locate_space = self._locate
        made.convert_timespec_time_to_time_khr = lambda instance, spec: ctypes.c_long(
            spec.tv_sec * 10**9 + spec.tv_nsec + XR_AHEAD_NS
        )
        for kind in ("space", "session", "instance"):
            setattr(made, f"destroy_{kind}", self.alive.discard)
        return made

    def _made(self, name):
        self.alive.add(name)
        return name

    def _begin(self, session, info):
        self.begun += 1

    def _end(self, session):
        self.ended += 1

    def _poll(self, instance):
        if not self.events:
            raise self.xr.EventUnavailable
        event, buffer = self.events.popleft(), self.xr.EventDataBuffer()
        ctypes.memmove(ctypes.byref(buffer), ctypes.byref(event), ctypes.sizeof(event))
        return buffer

    def _locate(self, space, base, xr_time):
        self.thread.add(threading.get_ident())
        assert isinstance(xr_time, int)
        assert (space, base) in {("space VIEW", "space LOCAL"), ("space VIEW", "space STAGE")}
        if self.fails is not None:
            raise self.fails
        x, y, z, *q = _path(xr_time - XR_AHEAD_NS)
        pose = self.xr.Posef(self.xr.Quaternionf(*q), self.xr.Vector3f(x, y, z))
        return SimpleNamespace(pose=pose, location_flags=self.xr.SpaceLocationFlags(self.flags))


@pytest.fixture(scope="session")
def make_runtime():
    """Makes runtimes that are ready."""
    xr = pytest.importorskip("xr", reason="pyopenxr is not here: pip install pyopenxr PyOpenGL")

    def make():
        runtime = FakeRuntime(xr)
        for state in ("IDLE", "READY", "SYNCHRONIZED", "VISIBLE", "FOCUSED"):
            runtime.state(state)
        return runtime

    return make


@pytest.fixture
def fake(monkeypatch, make_runtime):
    """The made-up runtime, ready, in the place of pyopenxr."""
    runtime = make_runtime()
    module = runtime.module()
    monkeypatch.setattr("vrbench_openxr.runtime.load", lambda: module)
    return runtime


@pytest.fixture
def path():
    """The made-up head's path: a function of the time on the system's clock [ns]."""
    return _path
