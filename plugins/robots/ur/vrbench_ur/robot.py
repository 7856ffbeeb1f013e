"""The arm as vrbench's port: plans, approaches, replays, and is recorded meanwhile."""

from __future__ import annotations

import time
from collections.abc import Generator
from contextlib import closing
from functools import cached_property
from typing import Any, Self

import numpy as np

from vrbench.devices.ports import Plan, Session
from vrbench.errors import ConfigError, DeviceError
from vrbench.geometry import Floats, Ints, Transform, rotvec_to_quat
from vrbench.streams import Columns, Event, Joints, Samples, States
from vrbench.trajectory import NS, Trajectory
from vrbench_ur.arms import JOINTS, Arm, Dh
from vrbench_ur.calibration import difference
from vrbench_ur.control import Control
from vrbench_ur.controller_clock import ControllerClock
from vrbench_ur.options import Options
from vrbench_ur.plan import UrPlan, start_posture
from vrbench_ur.planner import Planner
from vrbench_ur.planning import own
from vrbench_ur.primary import read_kinematics
from vrbench_ur.probe import check_controller
from vrbench_ur.reader import Reader
from vrbench_ur.safety import RobotFaultError, check_measured

# Postures that are checked for distance on the straight way to a plan's start.
APPROACH_POINTS = 200


class UrRobot:
    """One arm. Entered, it is read; it is moved only by plans that the session's permit allows."""

    def __init__(self, arm: Arm, options: Options, session: Session) -> None:
        self.arm, self.options, self.session = arm, options, session
        self._reader: Reader | None = None
        self._control: Control | None = None
        self._clock = ControllerClock()
        self._fault: RobotFaultError | None = None
        self._own: Dh | None = None
        self._rehearsed: set[str] = set()
        self._events: list[Event] = []
        self._target: Samples | None = None
        self._last_stamp = 0.0

    def __enter__(self) -> Self:
        self._reader = Reader(
            self.options.host,
            self.options.rate_hz,
            self.session.host.now,
            self.options.timeout_s,
        )
        return self

    def __exit__(self, *error: object) -> None:
        if self._control is not None:
            self._control.close()
        if self._reader is not None:
            self._reader.close()

    @cached_property
    def planner(self) -> Planner:
        """Plans for this rig; made when it is first needed."""
        return Planner(self.arm, self.options, self.session.mounting)

    def plan(self, motion: Trajectory) -> UrPlan:
        """A plan for this rig, the same every time.

        Raises:
            ConfigError: the motion is no motion.
            PlanError: the arm can't do it.
        """
        return self.planner.plan(motion)

    # -- moving

    def _allowed(self, plan: Plan) -> UrPlan:
        """The plan, if a person allowed it and it was made for this rig.

        Raises:
            ConfigError: dry run, or a plan for another rig or robot.
        """
        mine = own(plan)
        if mine.arm != self.arm.name or mine.rig != self.planner.rig:
            raise ConfigError(
                f"the plan was made for another rig ({mine.arm})",
                field="plan",
                fix=f"plan the motion again with this rig's {self.arm.name}",
            )
        if not self.session.permit.allows(mine.hash):
            raise ConfigError(
                "dry run: nobody has allowed this plan",
                field="--execute",
                fix="give the hash of the run's plans, and confirm at the terminal",
            )
        return mine

    def _connected(self) -> Control:
        """The child that moves the arm; a fault while it connects stays like any other."""
        if self._fault is not None:
            raise self._fault
        if self._control is None:
            check_controller(self.arm, self.options)
            self._own = read_kinematics(self.options.host, self.options.timeout_s)
            try:
                self._control = Control(self.arm, self.options)
            except RobotFaultError as fault:
                self._fault = fault
                raise
        self._control.check()
        return self._control

    def _measured(self) -> Floats:
        """Where the joints are now (6,) [rad].

        Raises:
            DeviceError: the connection is lost.
        """
        reader = self._reader
        packet = None if reader is None or reader.lost else reader.latest()
        if packet is None:
            raise DeviceError(f"{self.options.host} sends nothing", fix="check the cable")
        return np.array(packet["actual_q"], dtype=np.float64)

    def prepare(self, plan: Plan) -> Generator[float]:
        """Goes slowly to where the plan starts; the first time, passes through it slowly.

        Raises:
            ConfigError: nobody allowed it, the plan is another rig's, remote control is off.
            DeviceError: the way there is not clear, or the arm stopped.
        """
        mine = self._allowed(plan)
        start = start_posture(mine)
        control = self._connected()
        self._check_way(self._measured(), start)
        yield from control.approach(start)
        percent = self.options.first_pass_percent
        if mine.hash in self._rehearsed or percent >= 100.0:
            return
        yield from control.servo(mine.path, percent / 100.0)
        self._check_way(self._measured(), start)
        yield from control.approach(start)
        self._rehearsed.add(mine.hash)

    def _check_way(self, here: Floats, start: Floats) -> None:
        """Refuses an approach that comes too near to anything.

        Raises:
            DeviceError: which bodies, and what to do.
        """
        u = np.linspace(0.0, 1.0, APPROACH_POINTS)[:, None]
        distance, pair = self.planner.cell.clearance(here + u * (start - here))
        worst = int(np.argmin(distance))
        if distance[worst] < self.options.workspace.clearance_m:
            a, b = self.planner.cell.pairs[pair[worst]]
            raise DeviceError(
                f"the way to the plan's start is not clear: {a} comes within "
                f"{1e3 * max(distance[worst], 0):.0f} mm of {b}",
                fix="nothing has moved; bring the arm nearer to the start by hand",
            )

    def execute(self, plan: Plan) -> Generator[float]:
        """Replays the plan from where it starts.

        Raises:
            ConfigError: nobody allowed it, or it is another rig's.
            DeviceError: the arm isn't where the plan starts, stopped, or had to be stopped.
        """
        mine = self._allowed(plan)
        control = self._connected()
        tolerance = float(np.radians(self.options.tolerance_deg))
        check_measured(self.arm, self._measured(), start_posture(mine), tolerance)
        begun = False
        # closing the inner one stops the arm
        with closing(control.servo(mine.path)) as steps:
            for done in steps:
                if not begun and control.last.get("event") == "begin":
                    begun = True
                    ago = max(time.time_ns() - int(control.last["t"]), 0)
                    t = mine.target.t + (self.session.host.now() - ago)
                    self._target = Samples.of(t, mine.target.pose)
                yield done
        told = {k: v for k, v in control.last.items() if k.endswith(("_ms", "_deg"))}
        if self._own is not None:
            off = difference(mine.path.at(mine.path.grid(30.0)), self.planner.dh, self._own)
            told |= {"kinematics_mean_mm": off.mean_mm, "kinematics_max_mm": off.max_mm}
        self._events.append(Event(self.session.host.now(), "replay", told))

    # -- recording

    def start(self, take: str) -> None:  # noqa: ARG002
        self._read_packets()
        self._clock = ControllerClock()
        self._events.clear()
        self._target = None

    def read(self) -> Columns:
        """What has arrived since the last call.

        Raises:
            DeviceError: the connection is lost, and all that came before it has been read.
        """
        times, packets = self._read_packets()
        if not len(times):
            reader = self._reader
            if reader is not None and reader.lost is not None:
                raise DeviceError(reader.lost, fix="check the cable; start again")
            columns = Columns({})
        else:
            columns = self._columns(times, packets)
        poses = dict(columns.poses)
        if self._target is not None:
            poses["robot/target"], self._target = self._target, None
        events, self._events = [*columns.events, *self._events], []
        return Columns(poses, columns.joints, events, states=columns.states)

    def stop(self) -> None:
        """Nothing to end: the controller sends on, and what comes between takes is let go."""

    def _read_packets(self) -> tuple[Ints, Any]:
        if self._reader is None:
            raise DeviceError("the robot is not connected")
        return self._reader.take()

    def _columns(self, times: Ints, packets: Any) -> Columns:
        device = np.rint(packets["timestamp"] * NS).astype(np.int64)
        t = self._clock.to_host(device, times)
        tcp = packets["actual_TCP_pose"].astype(np.float64)
        n = len(t)
        pose = Transform(tcp[:, :3], rotvec_to_quat(tcp[:, 3:]))
        samples = Samples.of(t, pose, receive_t=times)
        samples = Samples(device, t, times, pose, samples.flags, np.zeros(n, dtype=np.uint32))

        def joints(position: str, velocity: str) -> Joints:
            q, qd = (packets[name].astype(np.float64) for name in (position, velocity))
            return Joints(t, times, q, qd, JOINTS)

        speed = np.minimum(packets["speed_scaling"], packets["target_speed_fraction"])
        state = States(
            t=t,
            receive_t=times,
            device_t=device,
            speed_scaling=speed.astype(np.float64),
            safety=packets["safety_status_bits"].astype(np.uint32),
            runtime=packets["runtime_state"].astype(np.uint32),
        )
        return Columns(
            {"robot/tcp": samples},
            {
                "robot/joints": joints("actual_q", "actual_qd"),
                "robot/target_joints": joints("target_q", "target_qd"),
            },
            self._gaps(packets["timestamp"], t),
            states={"robot/state": state},
        )

    def _gaps(self, stamps: Floats, t: Ints) -> list[Event]:
        """An event for each place where the controller's own stamps leave something out."""
        period = 1.0 / self.options.rate_hz
        before = np.concatenate(([self._last_stamp or stamps[0] - period], stamps[:-1]))
        steps = stamps - before
        self._last_stamp = float(stamps[-1])
        return [
            Event(int(t[k]), "gap", {"source": "robot", "seconds": round(float(steps[k]), 4)})
            for k in np.flatnonzero(steps > 1.5 * period)
        ]
