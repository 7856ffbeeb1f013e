"""Conformance of robots: what is planned is carried out, only when allowed, and stops."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from vrbench.config.rig import SIMULATED
from vrbench.devices.host import RealClock
from vrbench.devices.ports import Plan
from vrbench.devices.rehearsal import Rehearsal
from vrbench.errors import VrbenchError
from vrbench.geometry import Floats, Transform, relative_angle, rotvec_to_quat
from vrbench.plugin.testing.child import check_without_device
from vrbench.plugin.testing.offered import WithStandIn
from vrbench.plugin.testing.opening import median_rate, opened, options_of, session
from vrbench.plugin.testing.patience import Tell, limited
from vrbench.plugin.testing.verdicts import NonconformityError, NotCheckedError, given, require
from vrbench.streams import Columns, Samples
from vrbench.trajectory import NS, Trajectory

STREAM = "robot/tcp"
REST_S = 0.5
# A robot lags; within as much the best match is looked for [s].
LAG_S = 1.0
# A robot that takes longer to open, plan, move a little and close hangs.
PATIENCE_S = 120.0
NEAR_M, NEAR_RAD = 0.01, np.radians(1.5)


def nod(seconds: float = 2.0) -> Trajectory:
    """`T_eye0_eye` of a small motion on all axes, at rest at its ends."""
    t = np.arange(round(seconds * 120) + 1) / 120.0
    ease = np.sin(np.pi * t / seconds) ** 2
    p = np.stack([0.04 * ease, 0.02 * ease * np.sin(3 * t), 0.03 * ease * np.sin(2 * t)], axis=1)
    r = np.stack([0.10 * ease * np.sin(2 * t), 0.15 * ease, 0.05 * ease], axis=1)
    return Trajectory(np.rint(t * NS).astype(np.int64), Transform(p, rotvec_to_quat(r)))


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """What came of a motion.

    Attributes:
        options: that the stand-in gave.
        plan: that was carried out.
        again: hashes of the same motion planned again, and of another.
        refused: what an attempt without leave raised; None where it moved.
        samples: where it was, over preparation, motion, and rest.
        begun: when the motion began [ns].
        rested: samples of the half second after a motion that was closed early, 0.2 s of grace.
        closed_again: what a second closing raised.
    """

    options: dict[str, Any]
    plan: Plan
    again: tuple[str, str]
    refused: Exception | None
    samples: Samples
    begun: int
    rested: Samples
    closed_again: Exception | None


class RobotConformance(WithStandIn):
    """What a robot is held to; its stand-in is a controller that moves nothing real."""

    kind = "robot"
    motion: ClassVar[Trajectory] = nod()

    @classmethod
    def moved(cls) -> Moved:
        """What came of a motion, carried out once for all tests of the class."""
        if cls.name == SIMULATED:
            raise NotCheckedError(
                "simulated devices move on a stage, in virtual time", "their own tests check them"
            )
        spec = cls.thing()

        def make() -> Any:
            try:
                return limited(lambda tell: cls._move(spec, tell), PATIENCE_S)
            except Exception as error:
                return error

        found = cls.kept("moved", make)
        if isinstance(found, Exception):
            raise found
        moved: Moved = found
        return moved

    @classmethod
    def came(cls) -> Moved:
        """The same, for checks of what came: where nothing did, another check tells."""
        return given(cls.moved, "it wasn't moved")

    @classmethod
    def _move(cls, spec: Any, tell: Tell) -> Moved:
        clock = RealClock()
        within = session(clock)
        rehearsal = Rehearsal(clock.now, clock.now(), spec.rate_hz, recentres=False)
        with cls.stand_in(rehearsal) as chosen:
            robot = opened("robot", spec, spec.options.model_validate(dict(chosen)), within)
            with robot as device:
                tell("plan()")
                plan = device.plan(cls.motion)
                other = Trajectory(
                    cls.motion.t, Transform(cls.motion.pose.p * 0.5, cls.motion.pose.q)
                )
                again = device.plan(cls.motion).hash, device.plan(other).hash
                tell("execute() without leave")
                refused = _refused(device, plan)
                within.permit.grant([plan.hash])
                tell("start()")
                device.start("conformance")
                parts: list[Columns] = []
                tell("prepare()")
                _go(device, device.prepare(plan), parts)
                begun = clock.now()
                tell("execute()")
                _go(device, device.execute(plan), parts)
                _rest(device, parts)
                tell("a motion that is given up")
                rested = _stopped_early(device, plan)
                tell("stop()")
                device.stop()
                tell("closing")
            tell("closing again")
            try:
                robot.__exit__(None, None, None)
                closed = None
            except Exception as error:
                closed = error
            tell("the stand-in's end")
        return Moved(dict(chosen), plan, again, refused, _tcp(parts), begun, rested, closed)

    def test_opening_without_a_device_fails_cleanly(self) -> None:
        """With no robot there, opening ends soon, in one error that says what to do."""
        try:
            options = self.moved().options
        except NotCheckedError:
            raise
        except Exception:  # what is wrong with it, another check tells
            options = options_of(self.thing(), self.stand_in)
        check_without_device(self.kind, self.name, options)

    def test_planning_again_gives_the_same_hash(self) -> None:
        """A plan's hash tells what the robot will do: the same plan, the same hash."""
        moved = self.moved()
        require(
            moved.again[0] == moved.plan.hash != moved.again[1],
            "the same motion planned twice has two hashes, or two motions have one",
            "Hash the planned joints or poses, rounded, and all options that matter.",
        )
        t = moved.plan.target.t
        require(
            t[0] == 0 and np.all(np.diff(t) > 0),
            f"the plan's target starts at {int(t[0])} ns",
            "Stamps of Plan.target begin with 0 and increase.",
        )

    def test_what_nobody_allowed_is_refused(self) -> None:
        """A real robot carries out no plan that the session's permit doesn't allow."""
        moved = self.came()
        if not self.thing().real:
            raise NotCheckedError("the robot is declared to be not real", "real=True in the spec")
        require(
            isinstance(moved.refused, VrbenchError),
            "it moves without leave"
            if moved.refused is None
            else f"without leave it raises {type(moved.refused).__name__}: {moved.refused}",
            "Ask session.permit.allows(plan.hash) in prepare and in execute; raise ConfigError.",
        )

    def test_stamps_never_go_back(self) -> None:
        """Stamps and arrivals come in order."""
        samples = self.came().samples
        for what, t in (("source", samples.source_t), ("receive", samples.receive_t)):
            require(
                np.all(np.diff(t) >= 0), f"{what} times go back", "Pass samples on in their order."
            )

    def test_quaternions_are_of_unit_length(self) -> None:
        """Every pose is finite and every quaternion of unit length."""
        pose = self.came().samples.pose
        off = np.abs(np.linalg.norm(pose.q, axis=1) - 1.0)
        require(
            np.isfinite(pose.p).all() and np.all(off < 1e-3),
            f"quaternions are off unit length by {np.max(off):.3g}",
            "Normalise what the controller tells.",
        )

    def test_known_twist(self) -> None:
        """What it says of itself is what was planned, a little later: frame, tool and unit."""
        moved = self.came()
        distance, angle = _followed(moved)
        require(
            distance < NEAR_M and angle < NEAR_RAD,
            f"it says it was {distance * 1e3:.0f} mm and {np.degrees(angle):.1f} deg off its plan",
            "Poses are T_base_tcp in metres, quaternions x y z w, in the frame of Plan.target.",
        )

    def test_rate_is_as_declared(self) -> None:
        """Poses come as often as the spec says."""
        declared, measured = self.thing().rate_hz, median_rate(self.came().samples)
        require(
            0.15 < measured / declared < 1.1,
            f"{measured:.0f} poses a second, {declared:g} declared",
            "rate_hz is the most that it sends.",
        )

    def test_closed_early_it_stops(self) -> None:
        """A motion that is given up stops the robot at once."""
        rested = self.came().rested
        require(len(rested) > 3, "no poses come after a motion was given up", "Go on reading.")
        way = float(np.ptp(rested.pose.p, axis=0).max())
        require(
            way < 1e-3,
            f"it still moves {way * 1e3:.1f} mm after its motion was closed",
            "Stop the robot in execute's `except GeneratorExit` or `finally`, before it returns.",
        )

    def test_closing_twice(self) -> None:
        """Closing what is closed already does nothing."""
        error = self.came().closed_again
        require(
            error is None,
            f"closing a second time raises {type(error).__name__}: {error}",
            "Release in __exit__ what is held, and forget it.",
        )


def _refused(device: Any, plan: Plan) -> Exception | None:
    """What an attempt to move without leave raises; the attempt is given up at its first step."""
    for begin in (device.prepare, device.execute):
        way = begin(plan)
        try:
            next(way)
        except Exception as error:
            refused: Exception | None = error
        else:
            refused = None
        finally:
            way.close()
        if not isinstance(refused, VrbenchError):
            return refused
    return refused


def _go(device: Any, way: Any, parts: list[Columns]) -> None:
    parts.extend(device.read() for _ in way)


def _rest(device: Any, parts: list[Columns]) -> None:
    end = time.monotonic() + REST_S
    while time.monotonic() < end:
        time.sleep(0.02)
        parts.append(device.read())


def _stopped_early(device: Any, plan: Plan) -> Samples:
    """Poses after the motion was given up halfway."""
    for _ in device.prepare(plan):
        pass
    way = device.execute(plan)
    for done in way:
        if done > 0.4:
            break
    way.close()
    time.sleep(0.2)
    device.read()
    parts: list[Columns] = []
    _rest(device, parts)
    return _tcp(parts)


def _tcp(parts: list[Columns]) -> Samples:
    found = [part.poses[STREAM] for part in parts if len(part.poses.get(STREAM, ()))]
    if not found:
        raise NonconformityError(
            f"no poses of {STREAM} come", "read() returns Columns({'robot/tcp': Samples(...)})."
        )
    return Samples.concatenate(found)


def _followed(moved: Moved) -> tuple[float, float]:
    """How far it was off its plan at the lag that fits best: median [m] and [rad]."""
    samples, target = moved.samples, moved.plan.target
    during = samples.receive_t >= moved.begun
    since: Floats = (samples.receive_t[during] - moved.begun) / NS
    pose = samples.pose[during]
    best = np.inf, np.inf
    for lag in np.arange(-0.1, LAG_S, 0.01):
        t = np.rint((since - lag) * NS).astype(np.int64)
        true = target.at(np.clip(t, target.t[0], target.t[-1]))
        distance = float(np.median(np.linalg.norm(pose.p - true.p, axis=1)))
        best = min(best, (distance, float(np.median(relative_angle(pose.q, true.q)))))
    return best
