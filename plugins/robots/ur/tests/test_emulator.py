"""The real ur-rtde client against the emulator; in a process of its own, for it may abort."""

import json
import subprocess
import sys
import textwrap

import numpy as np
import pytest
from vrbench_ur.arms import UR5E
from vrbench_ur.emulator.controller import Controller
from vrbench_ur.emulator.twin import TICK_S, Twin, rotation, rotvec
from vrbench_ur.kinematics import flange

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="ur-rtde's wheels are Linux's")


def client(host, body):
    """What a script prints last, as JSON, that has the real client's classes at hand."""
    script = (
        "import json, sys, time\n"
        "import dashboard_client, rtde_control, rtde_io, rtde_receive\n"
        f"host = {host!r}\n" + textwrap.dedent(body)
    )
    ran = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False
    )
    assert ran.stdout.strip(), ran.stderr
    return json.loads(ran.stdout.strip().splitlines()[-1])


def test_receive_control_io_and_dashboard_connect_and_agree(emulator):
    told = client(
        emulator.host,
        """
        d = dashboard_client.DashboardClient(host)
        d.connect()
        r = rtde_receive.RTDEReceiveInterface(host)
        c = rtde_control.RTDEControlInterface(host)
        io = rtde_io.RTDEIOInterface(host)
        out = dict(model=d.getRobotModel(), remote=d.isInRemoteControl(), mode=d.robotmode())
        out["payload"] = c.setPayload(1.5, [0, 0.05, 0.2])
        out["tcp"] = c.setTcp([0, 0, 0.1, 0, 0, 0])
        out["tcp_back"] = c.getTCPOffset()
        time.sleep(0.1)
        out["payload_back"] = r.getPayload()
        goal = r.getActualQ()
        goal[0] += 0.1
        out["moved"] = c.moveJ(goal, 1.0, 2.0)
        time.sleep(0.1)
        out["off"] = abs(r.getActualQ()[0] - goal[0])
        out["safe"] = c.isJointsWithinSafetyLimits(goal)
        out["far"] = c.isPoseWithinSafetyLimits([3.0, 0, 0, 0, 0, 0])
        out["slider"] = io.setSpeedSlider(0.5)
        time.sleep(0.1)
        out["speed"] = r.getTargetSpeedFraction()
        io.setSpeedSlider(1.0)
        path = rtde_control.Path()
        for k in range(20):
            joints = [x + 0.005 * k for x in goal]
            entry = rtde_control.PathEntry(
                rtde_control.PathEntry.MoveJ,
                rtde_control.PathEntry.PositionJoints,
                joints + [1.0, 1.0, 0.001],
            )
            path.addEntry(entry)
        out["path"] = c.movePath(path)
        time.sleep(0.1)
        out["end"] = max(abs(a - b) for a, b in zip(r.getActualQ(), joints))
        before = r.getActualQ()[5]
        for k in range(100):
            begin = c.initPeriod()
            joints[5] += 0.001
            out["servo"] = c.servoJ(joints, 0, 0, 0.002, 0.03, 600)
            c.waitPeriod(begin)
        c.servoStop(10.0)
        out["servoed"] = r.getActualQ()[5] - before
        c.stopScript()
        c.disconnect()
        r.disconnect()
        print(json.dumps(out))
        """,
    )
    assert told["model"] == "UR5"
    assert told["mode"] == "Robotmode: RUNNING"
    for what in ("remote", "payload", "tcp", "moved", "safe", "slider", "path", "servo"):
        assert told[what] is True, what
    assert told["far"] is False
    assert told["tcp_back"] == [0, 0, 0.1, 0, 0, 0]
    assert told["payload_back"] == 1.5
    assert told["speed"] == 0.5
    assert told["off"] < 1e-3
    # the client's path text has six digits
    assert told["end"] < 1e-3
    assert 0.05 < told["servoed"] < 0.11


def test_the_client_sees_a_protective_stop_and_unlocks_it_after_five_seconds_only(emulator):
    told = client(
        emulator.host,
        """
        r = rtde_receive.RTDEReceiveInterface(host)
        c = rtde_control.RTDEControlInterface(host)
        d = dashboard_client.DashboardClient(host)
        d.connect()
        c.triggerProtectiveStop()
        time.sleep(0.2)
        out = dict(stopped=r.isProtectiveStopped(), move=c.moveJ(r.getActualQ(), 1.0, 1.0))
        try:
            d.unlockProtectiveStop()
            out["early"] = True
        except Exception as error:
            out["early"] = str(error)
        print(json.dumps(out))
        sys.stdout.flush()
        import os
        os._exit(0)
        """,
    )
    assert told["stopped"] is True
    assert told["move"] is False
    assert told["early"] is not True
    assert "protective stop" in emulator.report()["events"][-1][1]


@pytest.mark.parametrize("version", ["5.12.2", "5.24.0", "3.15.0", "10.11.0"])
def test_other_versions_of_the_controller_connect(emulators, version):
    emulator = emulators("--version", version)
    told = client(
        emulator.host,
        """
        c = rtde_control.RTDEControlInterface(host)
        out = c.isProgramRunning()
        c.disconnect()
        print(json.dumps(out))
        """,
    )
    assert told is True


def test_in_use_local_mode_and_mute(emulators):
    body = """
        try:
            rtde_control.RTDEControlInterface(host)
            out = "connected"
        except Exception as error:
            out = str(error)
        print(json.dumps(out))
        sys.stdout.flush()
        import os
        os._exit(0)
    """
    busy = emulators()
    busy.tell("in-use 0")
    busy.report()
    assert "already in use" in client(busy.host, body)
    assert "enable remote control" in client(emulators("--local").host, body)


def test_what_the_client_asks_is_answered_and_what_is_not_emulated_is_no_success(emulator):
    told = client(
        emulator.host,
        """
        r = rtde_receive.RTDEReceiveInterface(host)
        c = rtde_control.RTDEControlInterface(host)
        io = rtde_io.RTDEIOInterface(host)
        q = r.getActualQ()
        near = [x + 0.3 for x in q]
        c.getStepTime()  # the client reads before the answer can be there
        time.sleep(0.1)
        out = dict(step=c.getStepTime())
        out["ahead"] = c.getForwardKinematics(q, [0.0] * 6)
        out["here"] = r.getActualTCPPose()
        out["back"] = max(abs(a - b) for a, b in zip(c.getInverseKinematics(out["here"], near), q))
        out["bit"] = io.setStandardDigitalOut(3, True)
        time.sleep(0.1)
        out["bits"] = r.getActualDigitalOutputBits()
        c.moveJ(near, 0.5, 0.5, True)
        time.sleep(0.1)
        out["under_way"] = c.getAsyncOperationProgressEx().isAsyncOperationRunning()
        time.sleep(2.0)
        out["arrived"] = not c.getAsyncOperationProgressEx().isAsyncOperationRunning()
        print(json.dumps(out))
        sys.stdout.flush()
        up = list(r.getActualTCPPose())
        up[2] += 0.02
        out["line"] = c.moveL(up, 0.1, 0.3)
        print(json.dumps(out))
        sys.stdout.flush()
        import os
        os._exit(0)
        """,
    )
    assert told["step"] == 0.002
    np.testing.assert_allclose(told["ahead"][:3], told["here"][:3], atol=1e-4)
    assert told["back"] < 1e-4
    assert told["bit"] is True
    assert told["bits"] == 1 << 3
    assert told["under_way"] is True
    assert told["arrived"] is True
    assert told["line"] is False
    assert emulator.ticks("program stopped: command 3 is not emulated")


def test_a_joint_past_its_end_is_a_protective_stop():
    controller = running()
    goal = list(controller.twin.q)
    goal[5] += 7.0
    for i, x in enumerate([*goal, 3.0, 10.0]):
        controller.write(f"input_double_register_{i}", x)
    controller.write("input_int_register_0", 1)
    while not controller.safety_bits & 4 and controller.tick_count < 5000:
        controller.tick()
    assert controller.safety_bits & 4
    for _ in range(100):
        controller.tick()
    assert abs(controller.twin.q[5]) < 2 * np.pi + 0.2


def test_servo_lags_by_its_lookahead():
    twin = Twin(UR5E, seed=1)
    start = list(twin.q)
    behind = []
    for k in range(1000):
        goal = [x + 0.5 * k * TICK_S for x in start]
        twin.servo(goal, 0.1)
        twin.tick()
        behind.append((goal[0] - twin.q[0]) / 0.5)
    assert behind[-1] == pytest.approx(0.1, abs=0.003)


def test_at_rest_the_encoders_tremble_by_micrometres_and_repeats_differ_by_hundredths():
    twin = Twin(UR5E, seed=1)
    tcp = np.array([twin.tcp(twin.encoders())[:3] for _ in range(2000)])
    assert 1e-6 < np.linalg.norm(tcp.std(axis=0)) < 2e-5
    ends = []
    for seed in range(20):
        other = Twin(UR5E, seed)
        other.move([x + 0.2 for x in other.q], 1.0, 2.0)
        while other.busy:
            other.tick()
        for _ in range(50):
            other.tick()
        ends.append(other.tcp(other.actual)[:3])
    assert 5e-6 < np.linalg.norm(np.std(ends, axis=0)) < 1e-4


def test_the_same_seed_gives_the_same_arm():
    def run(seed):
        twin = Twin(UR5E, seed)
        twin.move([x + 0.1 for x in twin.q], 1.0, 1.0)
        for _ in range(300):
            twin.tick()
        return twin.encoders()

    assert run(3) == run(3)
    assert run(3) != run(4)


def test_its_kinematics_are_the_published_ones():
    twin = Twin(UR5E, seed=1)
    rng = np.random.default_rng(0)
    for q in rng.uniform(-3, 3, (20, 6)):
        want = flange(q, UR5E.dh).matrix()
        got = twin.tcp(q)
        np.testing.assert_allclose(got[:3], want[:3, 3], atol=1e-12)
        np.testing.assert_allclose(rotation(got[3:]), want[:3, :3], atol=1e-12)
        np.testing.assert_allclose(rotation(rotvec(want[:3, :3].tolist())), want[:3, :3], atol=1e-9)


def running():
    controller = Controller(UR5E, seed=1)
    controller.upload("def program():\nend")
    for _ in range(3):
        controller.tick()
    assert controller.out_int[0] == 1
    return controller


def test_the_watchdog_ends_the_program_when_commands_cease():
    controller = running()
    controller.write("input_double_register_0", 10.0)
    controller.write("input_int_register_0", 35)
    controller.tick()
    for _ in range(49):
        controller.tick()
    assert controller.runtime == 2
    for _ in range(5):
        controller.tick()
    assert controller.runtime == 1
    assert controller.events[-1][1] == "program stopped: watchdog"


def test_half_speed_takes_twice_as_long():
    def ticks(slider):
        controller = running()
        controller.set_slider(slider)
        controller.twin.move([x + 0.2 for x in controller.twin.q], 1.0, 2.0)
        while controller.twin.busy:
            controller.tick()
        return controller.tick_count

    assert ticks(0.5) == pytest.approx(2 * ticks(1.0), rel=0.02)


def test_an_emergency_stop_ends_the_program_and_none_starts_until_cleared():
    controller = running()
    controller.emergency_stop()
    assert controller.runtime == 1
    controller.upload("def program():\nend")
    assert controller.runtime == 1
    controller.clear()
    controller.upload("def program():\nend")
    assert controller.runtime == 2
