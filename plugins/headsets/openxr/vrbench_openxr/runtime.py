"""An OpenXR runtime without graphics: a session, the head's place at a time, what happened.

`XR_MND_headless` needs no frames, so `xrWaitFrame` is never called. XrTime isn't any clock of the
system's: it is always converted, by `XR_KHR_convert_timespec_time` (Linux, CLOCK_MONOTONIC) or
`XR_KHR_win32_convert_performance_counter_time` (Windows).
"""

from __future__ import annotations

import ctypes
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Self

from vrbench.errors import DeviceError

HEADLESS = "XR_MND_headless"
TIMESPEC = "XR_KHR_convert_timespec_time"
COUNTER = "XR_KHR_win32_convert_performance_counter_time"
READY_S = 10.0
LOOK_S = 0.01
NS = 1_000_000_000
Space = Literal["local", "stage"]


@dataclass(frozen=True, slots=True)
class Located:
    """Where the head is at a time.

    Attributes:
        asked_ns: when the runtime was asked [ns], system's clock.
        xr_time: the time of the pose on the runtime's clock [ns].
        time_ns: the same on the system's clock [ns].
        pose: x y z qx qy qz qw, OpenXR's convention [m].
        flags: OpenXR's four location flags.
        epoch: one more at every recentre.
    """

    asked_ns: int
    xr_time: int
    time_ns: int
    pose: tuple[float, ...]
    flags: int
    epoch: int


def load() -> Any:
    """The module `xr` of pyopenxr.

    Raises:
        DeviceError: it isn't installed, or this system has no OpenXR.
    """
    # what the loader prints is in the errors as well
    os.environ.setdefault("XR_LOADER_DEBUG", "none")
    try:
        import xr
    except (ImportError, NotImplementedError, OSError) as error:
        raise DeviceError(
            f"OpenXR can't be loaded: {error}", fix="pip install pyopenxr PyOpenGL (Linux, Windows)"
        ) from error
    return xr


def now_ns() -> int:
    """The system's clock that runtimes convert to [ns]: CLOCK_MONOTONIC, or QPC on Windows."""
    return time.perf_counter_ns()


class Runtime:
    """A headless session, while it is entered.

    Args:
        space: the space that poses are given in; `stage` is never recentred by a button.
        xr: the module, for tests.
    """

    def __init__(self, space: Space = "local", xr: Any = None) -> None:
        self.epoch = 0
        self.running = False
        self.facts: dict[str, Any] = {"space": space}
        self._space_name = space
        self._xr = xr
        self._instance: Any = None
        self._session: Any = None
        self._view: Any = None
        self._base: Any = None
        self._changes: list[int] = []
        self._told: list[tuple[str, dict[str, Any]]] = []

    def __enter__(self) -> Self:
        self._xr = self._xr or load()
        try:
            self._open()
        except self._xr.exception.XrException as error:
            self._close()
            raise DeviceError(
                f"no OpenXR session: {error}",
                fix="start the headset's runtime and make it the active one (SteamVR, Monado);"
                f" it must have {HEADLESS}",
            ) from error
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self._close()

    def locate(self, ahead_ns: int = 0) -> Located:
        """The head's place now, or so long after now."""
        xr, asked = self._xr, now_ns()
        wanted = asked + ahead_ns
        xr_time = self._xr_time(wanted)
        while self._changes and xr_time >= self._changes[0]:
            self._changes.pop(0)
            self.epoch += 1
        location = xr.locate_space(self._view, self._base, xr_time)
        p, q = location.pose.position, location.pose.orientation
        return Located(
            asked_ns=asked,
            xr_time=xr_time,
            time_ns=wanted,
            pose=(p.x, p.y, p.z, q.x, q.y, q.z, q.w),
            flags=int(location.location_flags.value) & 15,
            epoch=self.epoch,
        )

    def events(self) -> Sequence[tuple[str, dict[str, Any]]]:
        """What has happened since the last call: kind and detail."""
        self._poll()
        told, self._told = self._told, []
        return told

    def _open(self) -> None:
        xr = self._xr
        convert = COUNTER if sys.platform == "win32" else TIMESPEC
        offered = {_text(x.extension_name) for x in xr.enumerate_instance_extension_properties()}
        lacking = [name for name in (HEADLESS, convert) if name not in offered]
        if lacking:
            raise DeviceError(
                f"the active OpenXR runtime lacks {', '.join(lacking)}",
                fix="Monado and SteamVR have it; others: use vrbench-webxr in the PC's browser",
            )
        application = xr.ApplicationInfo(application_name="vrbench")
        self._instance = xr.create_instance(
            xr.InstanceCreateInfo(
                application_info=application, enabled_extension_names=[HEADLESS, convert]
            )
        )
        form = xr.SystemGetInfo(form_factor=xr.FormFactor.HEAD_MOUNTED_DISPLAY)
        system = xr.get_system(self._instance, form)
        runtime = xr.get_instance_properties(self._instance)
        headset = xr.get_system_properties(self._instance, system)
        self.facts |= {
            "runtime": _text(runtime.runtime_name),
            "runtime_version": str(runtime.runtime_version),
            "system": _text(headset.system_name),
        }
        self._session = xr.create_session(self._instance, xr.SessionCreateInfo(system_id=system))
        kinds = xr.ReferenceSpaceType
        self._base_kind = kinds.LOCAL if self._space_name == "local" else kinds.STAGE
        self._view = self._reference(kinds.VIEW)
        self._base = self._reference(self._base_kind)
        end = time.monotonic() + READY_S
        while not self.running:
            self._poll()
            if time.monotonic() > end:
                raise DeviceError(
                    "the OpenXR session doesn't become ready", fix="is the headset plugged in?"
                )
            time.sleep(LOOK_S)

    def _reference(self, kind: Any) -> Any:
        xr = self._xr
        return xr.create_reference_space(
            self._session, xr.ReferenceSpaceCreateInfo(reference_space_type=kind)
        )

    def _close(self) -> None:
        """Destroys what there is; a runtime that is gone can't be told so."""
        xr = self._xr
        for destroy, thing in (
            ("destroy_space", self._view),
            ("destroy_space", self._base),
            ("destroy_session", self._session),
            ("destroy_instance", self._instance),
        ):
            if thing is not None:
                try:
                    getattr(xr, destroy)(thing)
                except xr.exception.XrException:
                    continue
        self._view = self._base = self._session = self._instance = None
        self.running = False

    def _poll(self) -> None:
        xr = self._xr
        while True:
            try:
                buffer = xr.poll_event(self._instance)
            except xr.EventUnavailable:
                return
            kinds = xr.StructureType
            if buffer.type == kinds.EVENT_DATA_SESSION_STATE_CHANGED:
                self._on_state(_as(buffer, xr.EventDataSessionStateChanged).state)
            elif buffer.type == kinds.EVENT_DATA_REFERENCE_SPACE_CHANGE_PENDING:
                change = _as(buffer, xr.EventDataReferenceSpaceChangePending)
                if change.reference_space_type == self._base_kind:
                    self._changes.append(int(change.change_time))
                    self._changes.sort()
                    self._told.append(("reset", {"space": self._space_name}))
            elif buffer.type == kinds.EVENT_DATA_INSTANCE_LOSS_PENDING:
                self.running = False
                self._told.append(("session-end", {"why": "the runtime goes away"}))
            elif buffer.type == kinds.EVENT_DATA_EVENTS_LOST:
                self._told.append(("note", {"what": "the runtime lost events"}))

    def _on_state(self, state: Any) -> None:
        xr = self._xr
        states = xr.SessionState
        if state == states.READY:
            stereo = xr.ViewConfigurationType.PRIMARY_STEREO
            begin = xr.SessionBeginInfo(primary_view_configuration_type=stereo)
            xr.begin_session(self._session, begin)
            self.running = True
            self._told.append(("session-start", {}))
        elif state in (states.STOPPING, states.LOSS_PENDING, states.EXITING):
            if state == states.STOPPING and self.running:
                xr.end_session(self._session)
            if self.running:
                self._told.append(("session-end", {"why": state.name.lower()}))
            self.running = False
        else:
            self._told.append(("visibility", {"state": state.name.lower()}))

    def _xr_time(self, system_ns: int) -> int:
        xr = self._xr
        if sys.platform == "win32":
            ticks = ctypes.c_longlong(_counter_of(system_ns))
            return _value(xr.convert_win32_performance_counter_to_time_khr(self._instance, ticks))
        spec = xr.timespec(system_ns // NS, system_ns % NS)
        return _value(xr.convert_timespec_time_to_time_khr(self._instance, spec))


def _value(number: Any) -> int:
    """Of a c_long, which is no integer; or of an integer."""
    return int(getattr(number, "value", number))


def _text(name: Any) -> str:
    return name.decode(errors="replace") if isinstance(name, bytes) else str(name)


def _as(buffer: Any, kind: Any) -> Any:
    return ctypes.cast(ctypes.byref(buffer), ctypes.POINTER(kind)).contents


def _counter_of(system_ns: int) -> int:
    """Ticks of QueryPerformanceCounter at a time of `time.perf_counter_ns`, which is its own."""
    frequency = ctypes.c_longlong()
    kernel = getattr(ctypes, "windll").kernel32  # noqa: B009  # there on Windows alone
    kernel.QueryPerformanceFrequency(ctypes.byref(frequency))
    return ticks_of(system_ns, frequency.value)


def ticks_of(system_ns: int, frequency: int) -> int:
    """Nanoseconds in ticks of a counter [Hz], in whole numbers: floats would lose digits."""
    return system_ns * frequency // NS
