"""The simulated headset: its own world and clock, and errors as its profile says."""

from __future__ import annotations

from types import TracebackType
from typing import Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from vrbench.devices.ports import HeadsetProfile, HeadsetSpec, Session
from vrbench.devices.simulated.noise import correlated, losses, rng_of
from vrbench.devices.simulated.stage import Stage, as_json
from vrbench.geometry import Floats, Transform, quat_multiply, rotvec_to_quat
from vrbench.streams import GOOD, Columns, Flag, Samples
from vrbench.trajectory import NS

# From base axes (z up) to a world as runtimes have it (y up).
Y_UP = Transform.of((0.0, 0.0, 0.0), (-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))


class Options(BaseModel):
    """Options of the simulated headset; None is drawn at random from the run's seed."""

    model_config = ConfigDict(extra="forbid")

    clock_offset_s: float | None = Field(None, description="its clock minus the host's [s]")
    clock_skew_ppm: float = Field(0.0, description="how much its clock gains [ppm]")
    mount_error_m: float = Field(0.004, ge=0.0, description="rms of X about nominal, each axis [m]")
    mount_error_rad: float = Field(0.01, ge=0.0, description="the same, rotation [rad]")
    receive_delay_s: float = Field(0.008, ge=0.0, description="from sample to arrival [s]")


class SimulatedHeadset:
    """Rides on the stage's flange: `T_world_eye = Y^-1 T_base_tcp X`, then errs."""

    def __init__(self, options: Options, profile: HeadsetProfile, session: Session) -> None:
        self._options, self._profile, self._session = options, profile, session
        self._stage: Stage = session.stage
        rng = rng_of(session.seed, "sitting")
        drawn = rng.uniform(-0.5, 0.5)
        self._offset_s = options.clock_offset_s if options.clock_offset_s is not None else drawn
        self._started = 0
        self._next = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        pass

    def start(self, take: str) -> None:
        """The app starts: a new world, upright, anywhere."""
        tracking, seed = self._profile.tracking, self._session.seed
        self._x = self._session.mounting @ self._slip()
        rng = rng_of(seed, "world", take)
        yaw = rotvec_to_quat(np.array([0.0, rng.uniform(-np.pi, np.pi), 0.0]))
        self._world_base = Transform(rng.normal(0.0, 0.5, 3), yaw) @ Y_UP
        self._started = self._session.host.now()
        self._next = 0
        self._white = rng_of(seed, "white", take)
        self._slow_p = correlated(
            rng_of(seed, "slow position", take),
            tracking.position_noise_m,
            tracking.correlation_s,
            3,
        )
        self._slow_r = correlated(
            rng_of(seed, "slow rotation", take),
            tracking.rotation_noise_rad,
            tracking.correlation_s,
            3,
        )
        self._lost = losses(rng_of(seed, "losses", take), tracking.lost_per_minute, tracking.lost_s)
        self._stage.truth["headset"] = {
            "tcp_eye": as_json(self._x),
            "base_world": as_json(self._world_base.inverse()),
            "clock_offset_s": self._offset_s,
            "clock_skew_ppm": self._options.clock_skew_ppm,
            "clock_epoch_ns": self._started,
        }

    def read(self) -> Columns:
        tracking, rate = self._profile.tracking, self._profile.rate_hz
        elapsed = (self._session.host.now() - self._started) / NS
        index = np.arange(self._next, max(self._next, int(elapsed * rate)))
        self._next += len(index)
        # seven draws a sample, sample by sample: batches of any size give the same stream
        white = self._white.normal(size=(len(index), 7))
        late = np.clip(white[:, 6] * tracking.interval_jitter_s, -0.4 / rate, 0.4 / rate)
        since = (index + 0.5) / rate + late
        t = self._started + np.rint(since * NS).astype(np.int64)
        pose = self._erring(self._world_base @ self._stage.tcp(t) @ self._x, since, white)
        lost = self._lost(since)
        flags = np.where(lost, GOOD & ~int(Flag.POSITION_TRACKED), GOOD).astype(np.uint32)
        stamped = t + np.rint(self._clock_error_ns(since)).astype(np.int64)
        samples = Samples(
            source_t=stamped,
            pose_t=stamped,
            receive_t=t + round(self._options.receive_delay_s * NS),
            pose=pose,
            flags=flags,
            epoch=np.zeros(len(t), dtype=np.uint32),
        )
        return Columns({"headset/eye": samples})

    def stop(self) -> None:
        pass

    def _slip(self) -> Transform:
        """How the headset sits off its nominal place; another way in each mount."""
        rng = rng_of(self._session.seed, "mount", str(self._stage.mount))
        return Transform(
            rng.normal(0.0, self._options.mount_error_m, 3),
            rotvec_to_quat(rng.normal(0.0, self._options.mount_error_rad, 3)),
        )

    def _erring(self, pose: Transform, since: Floats, white: Floats) -> Transform:
        tracking = self._profile.tracking
        p = self._slow_p(since) + white[:, :3] * tracking.position_jitter_m
        r = self._slow_r(since) + white[:, 3:6] * tracking.rotation_jitter_rad
        return Transform(pose.p + p, quat_multiply(pose.q, rotvec_to_quat(r)))

    def _clock_error_ns(self, since: Floats) -> Floats:
        return (self._offset_s + self._options.clock_skew_ppm * 1e-6 * since) * NS


HEADSET = HeadsetSpec(
    name="sim",
    title="Simulated headset, virtual time",
    profile=HeadsetProfile(rate_hz=72.0, cameras={0: "front"}),
    options=Options,
    open=SimulatedHeadset,
)
