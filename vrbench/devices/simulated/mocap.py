"""The simulated motion capture: a body on the mount, in a room of its own."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from vrbench.clocks import Exchanges
from vrbench.devices.ports import Session
from vrbench.devices.simulated.noise import losses, rng_of
from vrbench.devices.simulated.stage import Stage, as_json
from vrbench.devices.simulated.worlds import Y_UP
from vrbench.devices.specs import MocapSpec
from vrbench.geometry import Ints, Transform, quat_multiply, rotvec_to_quat
from vrbench.streams import GOOD, Columns, Samples
from vrbench.trajectory import NS

# The body's pivot on the mount, beside the headset.
T_TCP_BODY = Transform.of((0.05, 0.12, 0.24), (0.69, 0.05, -0.08, 0.72))
EXCHANGE_S = 0.25
WAY_NS = 60_000


class Options(BaseModel):
    """Options of the simulated motion capture; None is drawn at random from the run's seed."""

    model_config = ConfigDict(extra="forbid")

    body: str = Field("body", pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", description="the body's name")
    rate_hz: float = Field(240.0, ge=30.0, le=1000.0, description="frames a second [Hz]")
    noise_m: float = Field(1e-4, ge=0.0, description="white rms of positions, each axis [m]")
    noise_rad: float = Field(4e-4, ge=0.0, description="the same, rotation [rad]")
    receive_delay_s: float = Field(0.00625, ge=0.0, description="from exposure to arrival [s]")
    clock_offset_s: float | None = Field(None, description="its clock minus the host's [s]")
    clock_skew_ppm: float = Field(10.0, description="how much its clock gains [ppm]")
    lost_per_minute: float = Field(0.5, ge=0.0, description="how often the body is lost")
    lost_s: float = Field(0.1, ge=0.0, description="for how long [s]")


class SimulatedMocap:
    """Sees the body that rides on the stage's flange: `T_mocap_body = T_mocap_base T_base_tcp X`.

    Poses are stamped on the host's clock, as a source does that knows its cameras' clock; source
    times and clock exchanges are on that clock.
    """

    def __init__(self, options: Options, session: Session) -> None:
        self._options, self._session = options, session
        self._stage: Stage = session.stage
        rng = rng_of(session.seed, "mocap room")
        yaw = rotvec_to_quat(np.array([0.0, rng.uniform(-np.pi, np.pi), 0.0]))
        self._mocap_base = Transform(np.array([0.4, 0.8, -0.3]), yaw) @ Y_UP
        drawn = rng.uniform(-5000.0, 5000.0)
        given = options.clock_offset_s
        self._offset_s = drawn if given is None else given
        self._begin = session.host.now()
        self._read_until = self._exchanged_until = self._begin

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def start(self, take: str) -> None:
        options, seed = self._options, self._session.seed
        self._white = rng_of(seed, "mocap", take)
        self._trips = rng_of(seed, "mocap exchanges", take)
        self._lost = losses(
            rng_of(seed, "mocap losses", take), options.lost_per_minute, options.lost_s
        )
        self._started = self._read_until = self._exchanged_until = self._session.host.now()
        self._stage.truth["mocap"] = {
            "tcp_body": as_json(T_TCP_BODY),
            "mocap_base": as_json(self._mocap_base),
            "clock_offset_s": self._offset_s,
            "clock_skew_ppm": options.clock_skew_ppm,
            "clock_epoch_ns": self._begin,
        }

    def read(self) -> Columns:
        options, until = self._options, self._session.host.now()
        period = NS / options.rate_hz
        index = np.arange(_after(self._read_until, period), _after(until, period))
        self._read_until = until
        t = np.rint(index * period).astype(np.int64)
        # six draws a sample, sample by sample: batches of any size give the same stream
        white = self._white.normal(size=(len(t), 6))
        true = self._mocap_base @ self._stage.tcp(t) @ T_TCP_BODY
        turn = rotvec_to_quat(white[:, 3:] * options.noise_rad)
        lost = self._lost((t - self._started) / NS)
        samples = Samples(
            source_t=self._own(t),
            pose_t=t,
            receive_t=t + round(options.receive_delay_s * NS),
            pose=Transform(true.p + white[:, :3] * options.noise_m, quat_multiply(true.q, turn)),
            flags=np.where(lost, 0, GOOD).astype(np.uint32),
            epoch=np.zeros(len(t), dtype=np.uint32),
        )
        return Columns({f"mocap/{options.body}": samples}, clocks={"mocap": self._exchanges(until)})

    def stop(self) -> None:
        pass

    def _exchanges(self, until: int) -> Exchanges:
        """Requests since the last look, each way delayed a little and by chance."""
        period = EXCHANGE_S * NS
        first, last = _after(self._exchanged_until, period), _after(until, period)
        sent = np.rint(np.arange(first, last) * period).astype(np.int64)
        self._exchanged_until = until
        ways = WAY_NS + np.rint(self._trips.exponential(WAY_NS, (len(sent), 2))).astype(np.int64)
        came = sent + ways[:, 0]
        there = self._own(came)
        return Exchanges(sent, there, there, came + ways[:, 1])

    def _own(self, t: Ints) -> Ints:
        """Host times (n,) [ns] as the cameras' clock shows them."""
        gain = self._options.clock_skew_ppm * 1e-6 * (t - self._begin)
        return t + np.rint(gain + self._offset_s * NS).astype(np.int64)


def _after(t: int, period: float) -> int:
    """Index of the first sample at or after a time [ns], in samples of a period [ns]."""
    return int(-(-t // period))


MOCAP = MocapSpec(
    name="sim",
    title="Simulated motion capture, virtual time",
    open=SimulatedMocap,
    rate_hz=240.0,
    options=Options,
)
