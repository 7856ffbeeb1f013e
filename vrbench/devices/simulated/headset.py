"""The simulated headset: its own world and clock, and errors as its profile says."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator

from vrbench import __version__
from vrbench.devices.ports import Session
from vrbench.devices.simulated.answers import Answers
from vrbench.devices.simulated.noise import correlated, losses, rng_of
from vrbench.devices.simulated.stage import Stage, as_json
from vrbench.devices.simulated.worlds import Worlds
from vrbench.devices.specs import HeadsetProfile, HeadsetSpec, Tracking
from vrbench.geometry import (
    Bools,
    Floats,
    Ints,
    Transform,
    quat_conjugate,
    quat_multiply,
    quat_to_rotvec,
    rotvec_to_quat,
)
from vrbench.streams import GOOD, Columns, Event, Flag, Samples
from vrbench.trajectory import NS

# Over which accelerations are taken: more than a step of the planned motion.
BASELINE_NS = 20_000_000
WANDER_S = 2400.0
# More often than this in one take it isn't lost for good and found again.
MOST_LOST = 16


class Options(BaseModel):
    """Options of the simulated headset; None is drawn at random from the run's seed."""

    model_config = ConfigDict(extra="forbid")

    clock_offset_s: float | None = Field(None, description="its clock minus the host's [s]")
    clock_skew_ppm: float = Field(0.0, description="how much its clock gains [ppm]")
    clock_wander_ppm: float = Field(
        0.0, description="by how much that gain swings up and down, in 40 min [ppm]"
    )
    clock_exchanges: bool = Field(
        False, description="answers pings; pose times are then on the host's clock"
    )
    mount_error_m: float = Field(0.004, ge=0.0, description="rms of X about nominal, each axis [m]")
    mount_error_rad: float = Field(0.01, ge=0.0, description="the same, rotation [rad]")
    handling_slip_m: float = Field(
        0.0, ge=0.0, description="rms by which hands at its cameras move it, each axis [m]"
    )
    receive_delay_s: float = Field(0.008, ge=0.0, description="from sample to arrival [s]")
    recentre_s: tuple[float, ...] = Field(
        (), description="when the user recentres, after the start of each take [s]"
    )
    tracking: dict[str, float] = Field(
        default_factory=dict, description="numbers that replace those of the profile's tracking"
    )

    @field_validator("tracking")
    @classmethod
    def _known(cls, value: dict[str, float]) -> dict[str, float]:
        known = {f.name for f in fields(Tracking)} - {"source"}
        if unknown := sorted(set(value) - known):
            raise ValueError(f"no {', '.join(unknown)}; there are {', '.join(sorted(known))}")
        return value


class SimulatedHeadset:
    """Rides on the stage's flange: `T_world_eye = Y^-1 T_base_tcp X`, then errs."""

    def __init__(self, options: Options, profile: HeadsetProfile, session: Session) -> None:
        self._options, self._profile, self._session = options, profile, session
        replaced: dict[str, Any] = dict(options.tracking)
        self._tracking = replace(profile.tracking, **replaced)
        self._stage: Stage = session.stage
        rng = rng_of(session.seed, "sitting")
        drawn = rng.uniform(-0.5, 0.5)
        self._offset_s = options.clock_offset_s if options.clock_offset_s is not None else drawn
        self._opened = session.host.now()
        self._started = 0
        self._next = 0
        self._mount = 0
        self._worlds = Worlds(session.seed, 0, self._tracking, self._opened)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def start(self, take: str) -> None:
        """A take begins; the app runs on, so its world and its epochs are those of the mount."""
        tracking, seed = self._tracking, self._session.seed
        self._x = self._session.mounting @ self._slip()
        self._started = self._session.host.now()
        self._next = 0
        self._go_on()
        self._worlds.recentre(self._started + np.array(self._options.recentre_s) * NS)
        self._found = len(self._stage.found_again())
        self._relocated = rng_of(seed, "relocalisation", take).normal(
            0.0, tracking.relocalisation_m, (MOST_LOST, 3)
        )
        self._relocated[0] = 0.0
        self._white = rng_of(seed, "white", take)
        self._slow_p, self._slow_r = (
            correlated(rng_of(seed, name, take), rms, tracking.correlation_s, 3)
            for name, rms in (
                ("slow position", tracking.position_noise_m),
                ("slow rotation", tracking.rotation_noise_rad),
            )
        )
        self._lost = losses(rng_of(seed, "losses", take), tracking.lost_per_minute, tracking.lost_s)
        self._answers = None
        if self._options.clock_exchanges:
            self._answers = Answers(rng_of(seed, "answers", take), self._started, self._device_time)
        self._tell_truth()

    def _go_on(self) -> None:
        """The app goes on since the last take, or starts anew in a new mount."""
        stage = self._stage
        if stage.mount != self._mount:
            self._mount, self._asked = stage.mount, len(stage.recentred)
            seed = self._session.seed
            self._worlds = Worlds(seed, stage.mount, self._tracking, self._opened)
        self._worlds.forget_after(self._started)
        self._worlds.recentre(self._newly_asked())
        self._told = len(self._worlds.recentres)

    def _newly_asked(self) -> Ints:
        """When recentres were asked for since the last look (k,) [ns]."""
        asked = self._stage.recentred[self._asked :]
        self._asked += len(asked)
        return np.array(asked, dtype=np.int64)

    def _tell_truth(self) -> None:
        """Puts on the stage what is true of this take, as far as it has come."""
        tracking = self._tracking
        self._stage.truth["headset"] = {
            "tcp_eye": as_json(self._x),
            **self._worlds.truth(self._started),
            "clock_offset_s": self._offset_s,
            "clock_skew_ppm": self._options.clock_skew_ppm,
            "clock_wander_ppm": self._options.clock_wander_ppm,
            "clock_epoch_ns": self._started,
            "prediction_s": tracking.prediction_s,
            "scale_error": tracking.scale_error,
            "occlusion_growth": tracking.occlusion_growth,
            "relocated_m": self._relocated[1:].tolist(),
        }

    def read(self) -> Columns:
        tracking, rate = self._tracking, self._profile.rate_hz
        elapsed = (self._session.host.now() - self._started) / NS
        if len(asked := self._newly_asked()):
            self._worlds.recentre(asked)
            self._tell_truth()
        index = np.arange(self._next, max(self._next, int(elapsed * rate)))
        self._next += len(index)
        # seven draws a sample, sample by sample: batches of any size give the same stream
        white = self._white.normal(size=(len(index), 7))
        late = np.clip(white[:, 6] * tracking.interval_jitter_s, -0.4 / rate, 0.4 / rate)
        since = (index + 0.5) / rate + late
        t = self._started + np.rint(since * NS).astype(np.int64)
        covered = self._stage.covered(t)
        pose = self._erring(self._seen(t), since, white, covered)
        lost = self._lost(since)
        pose, blind = self._relocalised(pose, t, covered)
        lost |= blind
        flags = np.where(lost, GOOD & ~int(Flag.POSITION_TRACKED), GOOD).astype(np.uint32)
        stamped, clocks = self._device_time(t), {}
        pose_t = stamped
        if self._answers is not None:
            clocks["headset"] = self._answers.until(self._session.host.now())
            pose_t = self._answers.clock().to_reference(stamped)
        samples = Samples(
            source_t=stamped,
            pose_t=pose_t,
            receive_t=t + round(self._options.receive_delay_s * NS),
            pose=pose,
            flags=flags,
            epoch=self._worlds.epoch(t).astype(np.uint32),
        )
        return Columns({"headset/eye": samples}, events=self._recentred(), clocks=clocks)

    def facts(self) -> dict[str, str]:
        """See `vrbench.devices.ports.facts_of`."""
        ahead = self._tracking.prediction_s
        return {
            "logger_version": __version__,
            "prediction": f"{1e3 * ahead:g} ms" if ahead else "none",
            "world": self._worlds.name,
        }

    def stop(self) -> None:
        pass

    def _slip(self) -> Transform:
        """How the headset sits off its nominal place; another way in each mount.

        Every time that hands are at its cameras it slips a little.
        """
        stage, options = self._stage, self._options
        rng = rng_of(self._session.seed, "mount", str(stage.mount))
        sits = Transform(
            rng.normal(0.0, options.mount_error_m, 3),
            rotvec_to_quat(rng.normal(0.0, options.mount_error_rad, 3)),
        )
        hands = rng_of(self._session.seed, "hands", str(stage.mount))
        slips = hands.normal(0.0, options.handling_slip_m, (stage.handled, 3)).sum(axis=0)
        return Transform(sits.p + slips, sits.q)

    def _relocalised(self, pose: Transform, t: Ints, covered: Floats) -> tuple[Transform, Bools]:
        """Poses (n,) in a map that is off where it was found again, and where it isn't found."""
        found = self._stage.found_again()
        times = np.searchsorted(found, t, side="right")
        ago = t - np.concatenate(([t[0] - NS * 86_400] if len(t) else [0], found))[times]
        blind = (covered == 1.0) | (ago < self._tracking.relocalisation_s * NS)
        off = self._relocated[np.minimum(times - self._found, MOST_LOST - 1)]
        return Transform(pose.p + off, pose.q), blind

    def _seen(self, t: Ints) -> Transform:
        """`T_world_eye` (n,) as predicted, in worlds that drift and are too large or small."""
        start = self._stage.tcp(np.array([self._opened])) @ self._x
        pose = self._worlds.seen(t, self._predicted(t), start)
        return Transform(pose.p * (1.0 + self._tracking.scale_error), pose.q)

    def _predicted(self, t: Ints) -> Transform:
        """`T_base_eye` (n,) that it tells at host times t (n,): of a moment later, less what a
        prediction with constant velocities misses by then, half the acceleration times lead^2.
        """
        lead = self._tracking.prediction_s
        ahead = t + round(lead * NS)
        pose = self._stage.tcp(ahead) @ self._x
        if not lead:
            return pose
        before, after = (
            self._stage.tcp(ahead + side) @ self._x for side in (-BASELINE_NS, BASELINE_NS)
        )
        missed = -0.5 * (lead * NS / BASELINE_NS) ** 2
        back = quat_conjugate(pose.q)
        turned = quat_to_rotvec(quat_multiply(back, before.q))
        turned += quat_to_rotvec(quat_multiply(back, after.q))
        return Transform(
            pose.p + missed * (before.p + after.p - 2.0 * pose.p),
            quat_multiply(pose.q, rotvec_to_quat(missed * turned)),
        )

    def _erring(self, pose: Transform, since: Floats, white: Floats, covered: Floats) -> Transform:
        tracking = self._tracking
        grown = 1.0 + tracking.occlusion_growth * covered[:, None]
        p = grown * (self._slow_p(since) + white[:, :3] * tracking.position_jitter_m)
        r = grown * (self._slow_r(since) + white[:, 3:6] * tracking.rotation_jitter_rad)
        return Transform(pose.p + p, quat_multiply(pose.q, rotvec_to_quat(r)))

    def _device_time(self, t: Ints) -> Ints:
        """Its own clock (n,) [ns] at host times t (n,) [ns]."""
        since = (t - self._started) / NS
        swing = np.sin(np.pi * since / WANDER_S) ** 2 * WANDER_S / np.pi
        gained = self._options.clock_skew_ppm * since + self._options.clock_wander_ppm * swing
        return t + np.rint((self._offset_s + 1e-6 * gained) * NS).astype(np.int64)

    def _recentred(self) -> list[Event]:
        """The recentres since the last look, at times of the host's clock."""
        new = self._worlds.recentres[self._told :]
        new = new[new <= self._session.host.now()]
        self._told += len(new)
        return [Event(t, "recentre") for t in new.tolist()]


HEADSET = HeadsetSpec(
    name="sim",
    title="Simulated headset, virtual time",
    profile=HeadsetProfile(rate_hz=72.0, cameras={0: "front"}),
    options=Options,
    open=SimulatedHeadset,
)
