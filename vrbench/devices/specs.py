"""What a plugin hands in: a model of headset, a route to headsets, motion capture, a robot."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel, ConfigDict

from vrbench.devices.ports import Finding, MotionPlanner, Occlusion, PoseSource, Robot, Session
from vrbench.devices.rehearsal import Rehearsal
from vrbench.geometry import Transform

# Plays a rehearsal as the device would send it; yields the options with which `open` finds it.
StandIn = Callable[[Rehearsal], AbstractContextManager[Mapping[str, Any]]]


class NoDeviceOptions(BaseModel):
    """A device that needs no telling."""

    model_config = ConfigDict(extra="forbid")


@dataclass(frozen=True, slots=True)
class Tracking:
    """How a simulated stand-in for a headset errs. Made up unless `source` says otherwise.

    Attributes:
        position_noise_m: rms of the slow position error, each axis [m].
        rotation_noise_rad: rms of the slow rotation error, each axis [rad].
        correlation_s: correlation time of both [s].
        position_jitter_m: rms of the white position noise, each axis [m].
        rotation_jitter_rad: rms of the white rotation noise, each axis [rad].
        interval_jitter_s: rms of the sampling instants about the nominal rate [s].
        lost_per_minute: mean number of times tracking is lost in a minute.
        lost_s: how long each loss lasts [s].
        prediction_s: how far ahead of its stamp a pose is predicted. The prediction knows no
            acceleration: it errs by half of that times the square of this [s].
        scale_error: its distances too long by this, relative; ref/est is 1 / (1 + this).
        drift_m_per_min: slow drift of its world, in a direction of chance [m/min].
        drift_rad_per_min: the same of yaw, to a side of chance [rad/min].
        occlusion_growth: with a share s of its cameras covered, all its noise is 1 + s times this
            as large; with all of them covered its position isn't tracked. The paper's Quest Pro
            went from 3.05 mm to 6.08 with two of four cameras covered and 5.56 with three.
        relocalisation_s: after that, how long it takes to find its position again [s],
        relocalisation_m: and by how much its world is off then, rms of each axis [m].
        source: where the numbers come from.
    """

    position_noise_m: float = 0.0012
    rotation_noise_rad: float = 0.0015
    correlation_s: float = 2.0
    position_jitter_m: float = 0.0001
    rotation_jitter_rad: float = 0.0002
    interval_jitter_s: float = 0.0003
    lost_per_minute: float = 0.2
    lost_s: float = 0.15
    prediction_s: float = 0.0
    scale_error: float = 0.0
    drift_m_per_min: float = 0.0
    drift_rad_per_min: float = 0.0
    occlusion_growth: float = 1.6
    relocalisation_s: float = 1.2
    relocalisation_m: float = 0.002
    source: str = "made up"


@dataclass(frozen=True, slots=True)
class HeadsetProfile:
    """What is known of a headset model without asking the device.

    Attributes:
        rate_hz: nominal rate of poses [Hz].
        cameras: tracking cameras, name by id.
        clock: the clock of its stamps: `utc`, `monotonic` or `device`.
        occlusion: camera ids covered, by level; `none` and `all` are always there.
        tracking: how its simulated stand-in errs.
    """

    rate_hz: float
    cameras: Mapping[int, str] = field(default_factory=dict)
    clock: str = "device"
    occlusion: Mapping[str, tuple[int, ...]] = field(default_factory=lambda: {"none": ()})
    tracking: Tracking = field(default_factory=Tracking)

    def covered(self, level: str) -> Occlusion | None:
        """What a level covers on this model; None where it has no such level."""
        if level == "all":
            return Occlusion(level, self.cameras, 1.0)
        ids = self.occlusion.get(level, () if level == "none" else None)
        if ids is None:
            return None
        names = {id_: self.cameras.get(id_, f"camera {id_}") for id_ in ids}
        return Occlusion(level, names, len(names) / max(len(self.cameras), 1))


@dataclass(frozen=True, slots=True)
class HeadsetSpec:
    """A headset model, a route to headsets, or both.

    Attributes:
        name: what rigs call it in `plugin` or `device`.
        title: what it is, for people.
        profile: of the model; None where this is a route alone.
        options: the route's options, `extra="forbid"`.
        open: connects; None where recordings of this model can only be imported. The vendor's
            SDK is imported in here, not before.
        check: looks at the device for `vrbench rig check`, without moving anything.
        emulator: module that `vrbench plugin emulate NAME` runs as a process of its own.
        stand_in: plays known movements as the device would, for `vrbench plugin check NAME`.
    """

    name: str
    title: str
    profile: HeadsetProfile | None = None
    options: type[BaseModel] = NoDeviceOptions
    open: Callable[[Any, HeadsetProfile, Session], PoseSource] | None = None
    check: Callable[[Any, Session], Iterator[Finding]] | None = None
    emulator: str | None = None
    stand_in: StandIn | None = None


@dataclass(frozen=True, slots=True)
class MocapSpec:
    """A motion-capture system; attributes as in `HeadsetSpec`."""

    name: str
    title: str
    open: Callable[[Any, Session], PoseSource]
    rate_hz: float
    options: type[BaseModel] = NoDeviceOptions
    check: Callable[[Any, Session], Iterator[Finding]] | None = None
    emulator: str | None = None
    stand_in: StandIn | None = None


@dataclass(frozen=True, slots=True)
class RobotSpec:
    """A robot; attributes as in `HeadsetSpec`.

    Attributes:
        planner: plans without a robot, given options and the nominal `T_tcp_eye`; None where the
            robot only plans when connected.
        real: whether people must allow its plans before it moves: `vrbench.devices.permit`.
        where: which one it is, given options: its address, which people confirm before it moves.
    """

    name: str
    title: str
    open: Callable[[Any, Session], Robot]
    rate_hz: float
    options: type[BaseModel] = NoDeviceOptions
    check: Callable[[Any, Session], Iterator[Finding]] | None = None
    emulator: str | None = None
    stand_in: StandIn | None = None
    planner: Callable[[Any, Transform], MotionPlanner] | None = None
    real: bool = False
    where: Callable[[Any], str] | None = None
