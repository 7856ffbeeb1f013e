"""The simulated robot: a deterministic flange that lags, repeats to 0.03 mm, and never faults."""

from __future__ import annotations

import hashlib
from collections.abc import Generator
from typing import Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from vrbench.devices.ports import Plan, Session
from vrbench.devices.simulated.noise import correlated, rng_of
from vrbench.devices.simulated.stage import Stage
from vrbench.devices.specs import RobotSpec
from vrbench.geometry import Floats, Transform, quat_multiply, rotvec_to_quat
from vrbench.streams import Columns, Samples
from vrbench.trajectory import NS, Trajectory

# How far the virtual clock moves between two looks at the devices.
STEP_S = 5.0
# In the published recordings residuals stand out at 8-10 Hz: the mount's.
VIBRATION_HZ = 9.0
# The eye where the motion starts, in base: in front of the robot, yaw -45 deg, base z up.
START_EYE = Transform(
    np.array([0.40, 0.25, 0.55]),
    quat_multiply(
        rotvec_to_quat(np.array([0.0, 0.0, -np.pi / 4])),
        rotvec_to_quat(np.array([np.pi / 2, 0.0, 0.0])),
    ),
)


class Options(BaseModel):
    """Options of the simulated robot."""

    model_config = ConfigDict(extra="forbid")

    rate_hz: float = Field(125.0, ge=30.0, le=500.0, description="rate of logged poses [Hz]")
    repeatability_m: float = Field(3e-5, ge=0.0, description="rms between repeats [m]")
    encoder_noise_m: float = Field(5e-6, ge=0.0, description="white rms of logged poses [m]")
    encoder_noise_rad: float = Field(5e-6, ge=0.0, description="the same, rotation [rad]")
    lag_s: float = Field(0.03, ge=0.0, description="executed behind planned [s]")
    reload_s: float = Field(2.0, ge=0.0, description="to be ready again within a take [s]")
    vibration_m: float = Field(
        0.0, ge=0.0, description="rms of the mount's vibration, unfelt by the encoders [m]"
    )


class SimulatedRobot:
    """Moves the stage's flange in virtual time, and logs where its encoders say it is."""

    def __init__(self, options: Options, session: Session) -> None:
        self._options, self._session = options, session
        self._stage: Stage = session.stage
        self._take, self._run = "", 0
        self._read_until = 0
        self._target: Trajectory | None = None
        # It stands ready from the start: a headset may be read before anything moves.
        start = START_EYE @ session.mounting.inverse()
        self._stage.move(
            Trajectory(np.array([session.host.now()]), Transform(start.p[None], start.q[None]))
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def plan(self, motion: Trajectory) -> Plan:
        """The whole motion about the start pose: `T_base_tcp = T_base_eye0 M X^-1`."""
        target = motion.mapped(lambda m: START_EYE @ m @ self._session.mounting.inverse())
        content = np.column_stack((target.t / NS, target.pose.p, target.pose.q)).round(9)
        return Plan(target, hashlib.sha256(content.tobytes()).hexdigest())

    def prepare(self, plan: Plan) -> Generator[float]:  # noqa: ARG002
        """It is there already: in virtual time the flange starts where the plan does.

        Within a take it takes its time all the same, as robots do that are given a plan again.
        """
        if self._take:
            self._session.host.wait(self._options.reload_s)
        yield 1.0

    def execute(self, plan: Plan) -> Generator[float]:
        host, options = self._session.host, self._options
        rng = rng_of(self._session.seed, "robot", self._take, *self._runs())
        begin = host.now()
        t = plan.target.seconds(0)
        # still at both ends, where the flange rests between takes
        ends = np.clip(np.minimum(t, t[-1] - t) / 2.0, 0.0, 1.0)[:, None]
        wander = ends * correlated(rng, options.repeatability_m / np.sqrt(3), 1.0, 3)(t)
        stamps = plan.target.t + begin + round(options.lag_s * NS)
        felt = Trajectory(stamps, Transform(plan.target.pose.p + wander, plan.target.pose.q))
        self._stage.move(self._shaken(felt, ends), felt)
        self._target = Trajectory(plan.target.t + begin, plan.target.pose)
        self._stage.truth["robot"] = {
            "lag_s": options.lag_s,
            "plan": plan.hash,
            "vibration_m": options.vibration_m,
        }
        done, duration = 0.0, plan.target.duration_s + 1.0
        while done < duration:
            step = min(STEP_S, duration - done)
            host.wait(step)
            done += step
            yield done / duration

    def _runs(self) -> tuple[str, ...]:
        """What tells the runs of a take apart; nothing for the first."""
        self._run += 1
        return (str(self._run),) if self._run > 1 else ()

    def _shaken(self, felt: Trajectory, ends: Floats) -> Trajectory:
        """Where the flange truly is: it swings up and down in the mount's own tone."""
        if not self._options.vibration_m:
            return felt
        tone = np.sin(2.0 * np.pi * VIBRATION_HZ * felt.seconds(int(felt.t[0])))
        up = np.sqrt(2.0) * self._options.vibration_m * ends[:, 0] * tone
        p = felt.pose.p + up[:, None] * np.array([0.0, 0.0, 1.0])
        return Trajectory(felt.t, Transform(p, felt.pose.q))

    def start(self, take: str) -> None:
        self._take, self._run = take, 0
        self._noise = rng_of(self._session.seed, "encoders", take)
        self._read_until = self._session.host.now()

    def read(self) -> Columns:
        options, until = self._options, self._session.host.now()
        period = round(NS / options.rate_hz)
        t = np.arange(-(-self._read_until // period), -(-until // period)) * period
        self._read_until = until
        true = self._stage.encoders(t)
        # six draws a sample, sample by sample: batches of any size give the same stream
        noise = self._noise.normal(size=(len(t), 6))
        turn = rotvec_to_quat(noise[:, 3:] * options.encoder_noise_rad)
        logged = Transform(
            true.p + noise[:, :3] * options.encoder_noise_m, quat_multiply(true.q, turn)
        )
        poses = {"robot/tcp": Samples.of(t, logged)}
        if self._target is not None:
            poses["robot/target"] = Samples.of(self._target.t, self._target.pose)
            self._target = None
        return Columns(poses)

    def stop(self) -> None:
        self._take = ""


ROBOT = RobotSpec(
    name="sim",
    title="Simulated robot, virtual time",
    open=SimulatedRobot,
    rate_hz=125.0,
    options=Options,
)
