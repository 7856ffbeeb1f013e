"""What must stop the arm does; every test on the emulator, which is a process of its own."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from vrbench_ur import servo
from vrbench_ur.arms import ARMS, UR5E
from vrbench_ur.control import Control
from vrbench_ur.plan import start_posture
from vrbench_ur.reader import Reader
from vrbench_ur.robot import UrRobot
from vrbench_ur.safety import (
    APPROACH_SPEED,
    RobotFaultError,
    approach,
    check_blocking,
    clamp,
    safety_text,
)
from vrbench_ur.spline import JointPath
from vrbench_ur.testing import nod, options, wait_until

from vrbench.errors import ConfigError, DeviceError
from vrbench.recording.recorder import record_take
from vrbench.recording.take import read_take

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="control is for Linux")
MOTION = nod(3.0)
TICK_NS = 2_000_000
# 100 ms in the emulator's own ticks.
TICKS_100_MS = 50


@pytest.fixture
def ready(emulator, session):
    """An arm that stands where a plan starts, and the plan, allowed."""
    robot = UrRobot(UR5E, options(emulator.host), session)
    plan = robot.plan(MOTION)
    emulator.place(start_posture(plan) + 0.01)
    emulator.report()
    session.permit.grant([plan.hash])
    with robot:
        yield robot, plan


def replayed(robot, plan):
    for _ in robot.prepare(plan):
        pass
    yield from robot.execute(plan)


def moving(robot, plan):
    """A replay that is under way."""
    steps = replayed(robot, plan)
    for done in steps:
        last = robot._control.last
        if 0.1 < done < 0.9 and last.get("event") == "at" and robot._target is not None:
            break
    return steps


def test_nothing_moves_unless_a_person_allowed_this_very_plan(emulator, session):
    robot = UrRobot(UR5E, options(emulator.host), session)
    plan = robot.plan(MOTION)
    with robot:
        for step in (robot.prepare, robot.execute):
            with pytest.raises(ConfigError, match="dry run"):
                next(step(plan))
        session.permit.grant([robot.plan(nod(2.0)).hash])
        with pytest.raises(ConfigError, match="dry run"):
            next(robot.execute(plan))
        session.permit.grant([plan.hash])
        session.permit.revoke()
        with pytest.raises(ConfigError, match="dry run"):
            next(robot.execute(plan))
    assert emulator.ticks("program") == []


def test_a_plan_for_another_rig_is_refused(emulator, session):
    robot = UrRobot(UR5E, options(emulator.host), session)
    other = UrRobot(UR5E, options("127.0.0.99"), session)
    plan = other.plan(MOTION)
    session.permit.grant([plan.hash])
    with robot, pytest.raises(ConfigError, match="made for another rig"):
        next(robot.execute(plan))
    assert emulator.ticks("program") == []


def test_a_replay_is_recorded_and_follows_its_plan(emulator, session, tmp_path):
    robot = UrRobot(UR5E, options(emulator.host, rate_hz=500.0), session)
    plan = robot.plan(MOTION)
    emulator.place(start_posture(plan) + 0.01)
    emulator.report()
    session.permit.grant([plan.hash])
    with robot:
        recorded_and_compared(robot, plan, session, tmp_path)
    told = emulator.report()
    assert told["payload"] == 1.9
    assert told["tcp"] == [0.0] * 6


def recorded_and_compared(robot, plan, session, tmp_path):
    for _ in robot.prepare(plan):
        pass
    path = tmp_path / "replay.mcap"
    host = session.host
    record_take(path, {}, {"robot": robot}, robot.execute(plan), host, lambda *_: None)
    take = read_take(path)
    target, tcp = take.poses["robot/target"].trajectory(), take.poses["robot/tcp"].trajectory()
    # in space alone: on a busy machine the replay falls behind, but never leaves its path
    apart = np.linalg.norm(tcp.pose.p[::5, None] - target.pose.p[None], axis=2).min(axis=1)
    assert 1e3 * apart.max() < 3.0
    reached = np.linalg.norm(target.pose.p[::5, None] - tcp.pose.p[None], axis=2).min(axis=1)
    assert 1e3 * reached.max() < 3.0
    state = take.states["robot/state"]
    assert (state.safety == 1).all()
    assert (state.speed_scaling == 1.0).all()
    np.testing.assert_allclose(np.diff(state.device_t), 2_000_000, atol=10)
    assert len(take.joints["robot/joints"]) == len(take.joints["robot/target_joints"])
    (event,) = [event for event in take.events if event.kind == "replay"]
    assert event.detail["error_deg"] < 6.0


def test_where_the_arm_is_not_the_plan_does_not_start(ready, emulator):
    robot, plan = ready
    with pytest.raises(DeviceError, match="ur5e is not where the plan starts"):
        next(robot.execute(plan))
    assert emulator.ticks("servo") == []


def test_the_approach_is_slow_and_the_first_pass_too(emulator, session):
    robot = UrRobot(UR5E, options(emulator.host, first_pass_percent=50.0), session)
    plan = robot.plan(nod(1.5))
    emulator.place(start_posture(plan) + 0.1)
    emulator.report()
    session.permit.grant([plan.hash])
    fastest = np.abs(plan.path.at(plan.path.grid(100.0), 1)).max()
    with robot:
        for _ in robot.prepare(plan):
            pass
        read = robot.read()
        joints, state = read.joints["robot/joints"], read.states["robot/state"]
        servo = emulator.ticks("servo")
        assert len(servo) == 1
        # by the controller's own time: on a busy machine the two parts last otherwise
        before = state.device_t < servo[0] * TICK_NS
        approach = np.abs(joints.velocity[before]).max()
        assert 0 < approach <= 1.05 * APPROACH_SPEED * UR5E.speed.min()
        assert np.abs(joints.velocity).max() < 1.1 * max(0.5 * fastest, approach)
        # once is enough
        for _ in robot.prepare(plan):
            pass
        assert emulator.ticks("servo") == servo


def test_a_way_that_is_not_clear_is_not_taken(ready, emulator):
    robot, plan = ready
    far = start_posture(plan)
    far[1] += np.pi
    emulator.place(far)
    emulator.report()
    with pytest.raises(DeviceError, match="the way to the plan's start is not clear"):
        next(robot.prepare(plan))
    assert emulator.ticks("moves") == []


@pytest.mark.parametrize(
    ("told", "why"),
    [
        ("protective", "protective stop"),
        ("estop", "emergency stop"),
        ("safeguard", "safeguard stop"),
        ("slider 0.5", "speed slider is at 50 %"),
        ("stick", "deg from its command"),
        ("freeze 2.5", "connection lost"),
        ("drop", "connection lost"),
    ],
)
def test_a_fault_ends_the_replay_and_stays(ready, emulator, told, why):
    robot, plan = ready
    steps = moving(robot, plan)
    emulator.tell(told)
    with pytest.raises(RobotFaultError, match=why):
        for _ in steps:
            pass
    # it latches: nothing goes on, unlocks or connects again by itself
    for step in (robot.prepare, robot.execute):
        with pytest.raises(RobotFaultError, match="nothing moves again by itself"):
            next(step(plan))
    emulator.tell("stick")
    wait_until(lambda: not emulator.report()["moving"])
    assert emulator.ticks("unlocked") == []
    assert len(emulator.ticks("program")) - len(emulator.ticks("program stopped")) == 1


def test_leaving_a_replay_stops_the_arm(ready, emulator):
    robot, plan = ready
    steps = moving(robot, plan)
    steps.close()
    wait_until(lambda: emulator.ticks("program stopped"))
    assert not emulator.report()["moving"]


def test_when_the_process_that_moves_it_dies_the_watchdog_stops_the_arm(ready, emulator):
    robot, plan = ready
    steps = moving(robot, plan)
    os.kill(robot._control.pid, signal.SIGKILL)
    with pytest.raises(RobotFaultError, match="ended by itself"):
        for _ in steps:
            pass
    wait_until(lambda: emulator.ticks("program stopped: watchdog"))
    wait_until(lambda: not emulator.report()["moving"])


def test_a_connection_that_breaks_keeps_what_was_recorded(ready, emulator, session, tmp_path):
    robot, plan = ready
    for _ in robot.prepare(plan):
        pass
    path = tmp_path / "broken.mcap"

    def movement():
        for done in robot.execute(plan):
            if done > 0.3:
                emulator.tell("drop")
            yield done

    with pytest.raises(DeviceError):
        record_take(path, {}, {"robot": robot}, movement(), session.host, lambda *_: None)
    assert not path.exists()
    kept = path.with_name("broken.mcap.part")
    kept.rename(path)
    assert len(read_take(path).poses["robot/tcp"]) > 200


MOVER = """
import sys
from vrbench.devices.host import RealClock
from vrbench.devices.permit import Permit
from vrbench.devices.ports import Session
from vrbench_ur.arms import UR5E
from vrbench_ur.robot import UrRobot
from vrbench_ur.testing import MOUNTING, nod, options

session = Session(RealClock(), MOUNTING, 1, permit=Permit())
robot = UrRobot(UR5E, options(sys.argv[1]), session)
plan = robot.plan(nod(8.0))
session.permit.grant([plan.hash])
with robot:
    for _ in robot.prepare(plan):
        pass
    for done in robot.execute(plan):
        if done > 0.2:
            print(robot._control.pid, flush=True)
"""


@pytest.fixture
def mover(emulator, session):
    """A process that replays a plan, in a group of its own, and the pid of its child."""
    plan = UrRobot(UR5E, options(emulator.host), session).plan(nod(8.0))
    emulator.place(start_posture(plan) + 0.01)
    emulator.report()
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(MOVER), emulator.host],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    )
    told = process.stdout.readline()
    assert told, process.stderr.read()
    yield process, int(told)
    if process.poll() is None:
        process.kill()
    process.wait()
    process.stdout.close()
    process.stderr.close()


def stopped_after(emulator, mark):
    """Ticks from the mark to the command that stops the arm."""
    stop = wait_until(lambda: [t for t in emulator.ticks("command 16") if t >= mark])
    return stop[0] - mark


def test_ctrl_c_stops_the_arm_within_100_ms(mover, emulator):
    process, child = mover
    emulator.tell("mark ctrl-c")
    os.killpg(process.pid, signal.SIGINT)
    (mark,) = emulator.ticks("mark ctrl-c")
    assert stopped_after(emulator, mark) <= TICKS_100_MS
    wait_until(lambda: not alive(child))
    wait_until(lambda: process.poll() is not None)
    assert not emulator.report()["moving"]


def test_an_interrupt_of_vrbench_alone_stops_the_arm_too(mover, emulator):
    process, child = mover
    os.kill(process.pid, signal.SIGINT)
    wait_until(lambda: emulator.ticks("program stopped"))
    wait_until(lambda: not alive(child))


def test_when_vrbench_is_killed_its_child_stops_the_arm(mover, emulator):
    process, child = mover
    emulator.tell("mark kill")
    process.kill()
    (mark,) = emulator.ticks("mark kill")
    stopped_after(emulator, mark)
    wait_until(lambda: not alive(child))
    wait_until(lambda: not emulator.report()["moving"])
    assert emulator.ticks("program stopped: asked to") or emulator.ticks("program stopped")


def alive(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


@pytest.mark.parametrize(
    ("arguments", "arm", "why"),
    [
        (["--local"], "ur5e", "remote control is off"),
        (["--mute"], "ur5e", "stays mute"),
        (["--model", "ur10e"], "ur5e", "is a UR10"),
        (["--model", "ur5e"], "ur10e", "is a UR5"),
    ],
)
def test_the_wrong_controller_is_one_clear_error(emulators, arguments, arm, why):
    from vrbench_ur.probe import check_controller

    emulator = emulators(*arguments)
    with pytest.raises((ConfigError, DeviceError), match=why):
        check_controller(ARMS[arm], options(emulator.host, timeout_s=0.5))


def test_a_stopped_robot_is_not_started(emulator):
    from vrbench_ur.probe import check_controller, findings

    emulator.tell("protective")
    emulator.report()
    with pytest.raises(DeviceError, match="PROTECTIVE_STOP"):
        check_controller(UR5E, options(emulator.host))
    (finding,) = findings(UR5E, options(emulator.host))
    assert not finding.ok
    emulator.tell("clear")
    emulator.report()
    assert all(finding.ok for finding in findings(UR5E, options(emulator.host)))


def test_registers_in_use_are_a_fault_and_no_crash(emulator):
    emulator.tell("in-use 0")
    emulator.report()
    with pytest.raises(RobotFaultError, match="already in use"):
        Control(UR5E, options(emulator.host))


def test_a_command_that_leaps_is_cut_and_is_a_fault(emulator):
    with Reader(emulator.host, 125.0, lambda: 0) as reader:
        wait_until(lambda: reader.latest() is not None)
        here = np.array(reader.latest()["actual_q"])
    knots = np.concatenate((np.zeros(6), np.full(6, 0.5)))
    points = here + np.array([0, 0, 0, 3.0, 3.0, 3.0])[:, None] * np.ones(6)
    with Control(UR5E, options(emulator.host)) as control:
        leap = JointPath(knots, points)
        with pytest.raises(RobotFaultError, match="too far from the one before"):
            for _ in control.servo(leap):
                pass
    wait_until(lambda: not emulator.report()["moving"])


class LateClock:
    """Time for a loop that sleeps: each fifth time it is woken 1.9 ms too late."""

    def __init__(self):
        self._now, self._slept = 0.0, 0

    def monotonic(self):
        return self._now

    def time_ns(self):
        return round(self._now * 1e9)

    def sleep(self, seconds):
        self._slept += 1
        self._now += seconds + (0.0019 if self._slept % 5 == 0 else 0.0)


def test_a_loop_that_is_late_now_and_then_replays_a_quick_path(monkeypatch):
    """The path goes on by what the loop was late, and that is no leap."""
    sent = []

    class Taking:
        def servoJ(self, goal, *_):  # noqa: N802 - as ur-rtde has it
            sent.append(goal)
            return True

        def servoStop(self, _):  # noqa: N802
            return True

    monkeypatch.setattr(servo, "time", LateClock())
    told = {"arm": "ur5e", "lookahead_s": 0.05, "gain": 300.0, "max_error_rad": 9.0, "behind_s": 9}
    child = servo.Child(told)
    child.control = Taking()
    for name in ("_poll", "_guard"):
        monkeypatch.setattr(child, name, lambda: None)
    monkeypatch.setattr(child, "_q", lambda: np.zeros(6))
    monkeypatch.setattr(
        child, "_check_state", lambda: {"actual_q": np.array(sent[-1:] or [[0.0] * 6])[0]}
    )
    knots = np.concatenate((np.zeros(6), np.full(6, 0.5)))
    straight = JointPath(knots, np.linspace(0.0, 0.45, 6)[:, None] * UR5E.speed)
    child._servo(straight, 1.0, 0.0)
    np.testing.assert_allclose(sent[-1], 0.45 * np.asarray(UR5E.speed), atol=1e-9)
    # 90 % of what the joints can do, and never as far as their limit lets them in two periods
    assert 0.9 < np.max(np.diff(sent, axis=0) / (np.asarray(UR5E.speed) * servo.PERIOD_S)) < 2.0


def test_the_clamp_keeps_what_the_limits_allow():
    last, speed = np.zeros(6), np.full(6, 3.0)
    same, cut = clamp(np.full(6, 0.005), last, speed, 0.002)
    assert not cut
    np.testing.assert_array_equal(same, np.full(6, 0.005))
    less, cut = clamp(np.full(6, -0.5), last, speed, 0.002)
    assert cut
    np.testing.assert_allclose(less, -0.0075)


def test_a_blocking_move_of_more_than_300_s_is_refused():
    check_blocking(299.0)
    with pytest.raises(ConfigError, match="longer than the client waits"):
        check_blocking(301.0)
    with pytest.raises(ConfigError, match="longer than the client waits"):
        approach(UR5E, np.zeros(6), np.full(6, 200.0))


@pytest.mark.parametrize(
    ("bits", "what"), [(0b100, "protective stop"), (1 << 7, "emergency"), (1 << 20, "0x100000")]
)
def test_safety_bits_are_told_in_words(bits, what):
    assert what in safety_text(bits)
