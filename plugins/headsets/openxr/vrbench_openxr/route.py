"""The route `openxr`: a PC headset beside the recorder, by its runtime."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from importlib.metadata import version
from typing import Any, Literal, Self
from uuid import uuid4

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from vrbench.devices.ports import Finding, Session
from vrbench.devices.specs import HeadsetProfile, HeadsetSpec
from vrbench.errors import DeviceError
from vrbench.streams import Columns, Event, Samples, believed
from vrbench_openxr.runtime import Located, Runtime, now_ns
from vrbench_openxr.sampler import Sampler

STREAM = "headset/eye"
CHECK_S = 1.0
LEAST_TRACKED = 0.95


class Options(BaseModel):
    """How the runtime is asked."""

    model_config = ConfigDict(extra="forbid")

    rate_hz: float = Field(500.0, ge=10, le=2000, description="how often to ask [Hz]")
    space: Literal["local", "stage"] = Field("local", description="the space of the poses")
    ahead_s: float = Field(
        0.0, ge=0, le=0.1, description="how far ahead of now to ask: 0 is no prediction [s]"
    )


class OpenXRHeadset:
    """One session of the runtime, kept over as many takes as the suite has."""

    def __init__(self, options: Options, _profile: HeadsetProfile | None, session: Session) -> None:
        self._options, self._host = options, session.host
        self._stack = ExitStack()
        self._lock = threading.Lock()
        self._poses: list[tuple[Located, int]] = []
        self._events: list[Event] = []
        self._taking = False
        self._epoch: int | None = None
        # its session numbers epochs on, from take to take
        self._world = uuid4().hex
        # of the recorder's clock over the system's, both steady
        self._ahead_ns = _difference(session)
        self._sampler = Sampler(
            Runtime(options.space),
            rate_hz=options.rate_hz,
            ahead_s=options.ahead_s,
            on_pose=self._on_pose,
            on_event=self._on_event,
        )

    def __enter__(self) -> Self:
        self._stack.enter_context(self._sampler)
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def start(self, take: str) -> None:
        """Poses belong to this take from now on.

        Raises:
            DeviceError: the session has ended.
        """
        if not self._sampler.running:
            raise DeviceError(
                f"can't record {take}: the OpenXR session has ended",
                field="headset",
                fix="start the runtime again, and the run with --resume",
            )
        facts = {**self._sampler.runtime.facts, **self._options.model_dump()}
        facts["pose_time"] = "as asked for"
        with self._lock:
            self._poses, self._epoch, self._taking = [], None, True
            self._events = [Event(self._host.now(), "headset", facts)]

    def facts(self) -> dict[str, str]:
        """What is known of the poses: see `vrbench.devices.ports.facts_of`."""
        ahead = self._options.ahead_s
        return {
            "logger_version": version("vrbench-openxr"),
            "prediction": f"{1e3 * ahead:g} ms ahead, asked for" if ahead else "none",
            "world": self._world,
        }

    def stop(self) -> None:
        """The take ends."""
        with self._lock:
            self._taking = False

    def read(self) -> Columns:
        """What has been located since the last call."""
        with self._lock:
            poses, self._poses = self._poses, []
            events, self._events = self._events, []
        return Columns({STREAM: samples_of(poses, self._ahead_ns)} if poses else {}, events=events)

    def _on_pose(self, located: Located) -> None:
        received = self._host.now()
        with self._lock:
            if not self._taking:
                return
            if self._epoch is not None and located.epoch != self._epoch:
                detail = {"epoch": located.epoch}
                self._events.append(Event(located.time_ns + self._ahead_ns, "recentre", detail))
            self._epoch = located.epoch
            self._poses.append((located, received))

    def _on_event(self, kind: str, detail: dict[str, Any]) -> None:
        with self._lock:
            if self._taking:
                self._events.append(Event(self._host.now(), kind, detail))


def samples_of(poses: list[tuple[Located, int]], ahead_ns: int) -> Samples:
    """Located poses with their times of receipt, as columns; what is no pose is no good one."""
    found = np.array([x.pose for x, _ in poses])
    pose, flags = believed(found[:, :3], found[:, 3:], [x.flags for x, _ in poses])
    return Samples(
        source_t=np.array([x.xr_time for x, _ in poses], dtype=np.int64),
        pose_t=np.array([x.time_ns for x, _ in poses], dtype=np.int64) + ahead_ns,
        receive_t=np.array([t for _, t in poses], dtype=np.int64),
        pose=pose,
        flags=flags,
        epoch=np.array([x.epoch for x, _ in poses], dtype=np.uint32),
    )


def _difference(session: Session) -> int:
    """How far the recorder's clock is ahead of the system's [ns]: of a few brackets the least."""
    readings = []
    for _ in range(5):
        before, host, after = now_ns(), session.host.now(), now_ns()
        readings.append((after - before, host - (before + after) // 2))
    return min(readings)[1]


def check(options: Options, session: Session) -> Iterator[Finding]:
    """Opens a session, asks for a second, and says what the runtime gives."""
    headset = OpenXRHeadset(options, None, session)
    try:
        with headset:
            facts = headset._sampler.runtime.facts
            headset.start("check")
            time.sleep(CHECK_S)
            headset.stop()
            columns = headset.read()
    except DeviceError as error:
        yield Finding(False, error.what, error.fix or "")
        return
    yield Finding(True, f"{facts['system']} by {facts['runtime']} {facts['runtime_version']}")
    samples = columns.poses.get(STREAM)
    if samples is None:
        yield Finding(False, "no poses come", "wake the headset")
        return
    rate, tracked = len(samples) / CHECK_S, float(np.mean(samples.good))
    yield Finding(
        rate > 0.9 * options.rate_hz,
        f"{rate:.0f} poses a second, asked for {options.rate_hz:g}",
        "ask for fewer, or close what else runs",
    )
    yield Finding(
        tracked >= LEAST_TRACKED, f"{tracked:.0%} of poses tracked", "base stations, light, a view"
    )


HEADSET = HeadsetSpec(
    name="openxr",
    title="PC headsets by their OpenXR runtime, without graphics",
    options=Options,
    open=OpenXRHeadset,
    check=check,
)
