import socket
import struct
import threading

import numpy as np
import pytest
from vrbench_ur import rtde
from vrbench_ur.arms import UR5E
from vrbench_ur.calibration import difference
from vrbench_ur.primary import HEAD, ROBOT_STATE, _search, kinematics_message, read_kinematics
from vrbench_ur.probe import findings
from vrbench_ur.testing import options


def same(a, b):
    return all(np.array_equal(getattr(a, x), getattr(b, x)) for x in ("d", "a", "alpha", "theta"))


def test_the_controllers_own_kinematics_are_read_and_their_difference_stated(emulators):
    emulator = emulators("--calibrated", "0.5")
    own = read_kinematics(emulator.host, 2.0)
    off = difference(np.zeros((1, 6)), UR5E.dh, own)
    assert 0.1 < off.max_mm < 5.0
    told = [finding.what for finding in findings(UR5E, options(emulator.host))]
    assert any("mm from where nominal kinematics do" in what for what in told)


def test_a_nominal_arm_differs_by_nothing(emulator):
    assert same(read_kinematics(emulator.host, 2.0), UR5E.dh)


@pytest.mark.parametrize("cut", [1, 4, 5, 9, 10, 100, 230])
def test_other_messages_are_passed_by_and_cuts_are_no_matter(cut):
    other = HEAD.pack(HEAD.size + 7, 20) + b"version"
    state = HEAD.pack(2 * HEAD.size + 3, ROBOT_STATE) + HEAD.pack(HEAD.size + 3, 0) + b"abc"
    data = other + state + kinematics_message(UR5E.dh, True)
    found, rest = _search(data[:cut])
    assert found is None
    found, _ = _search(rest + data[cut:])
    assert same(found, UR5E.dh)


def test_a_robot_state_as_the_maker_lays_it_out():
    # as its simulator 5.8 begins one: mode 47 bytes, joints 251, Cartesian 101, kinematics 225
    others = b"".join(
        struct.pack(">iB", size, kind) + bytes(size - 5)
        for size, kind in ((47, 0), (251, 1), (101, 4))
    )
    theta, alpha = (0.0,) * 6, (1.570796327, 0.0, 0.0, 1.570796327, -1.570796327, 0.0)
    a, d = (0.0, -0.425, -0.3922, 0.0, 0.0, 0.0), (0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996)
    kinematics = struct.pack(">iB6I", 225, 5, *[0xFFFFFFFF] * 6)
    kinematics += struct.pack(">24dI", *theta, *a, *d, *alpha, 0)
    masterboard = struct.pack(">iB", 75, 3) + bytes(70)
    body = others + kinematics + masterboard
    found, rest = _search(struct.pack(">iB", 5 + len(body), 16) + body)
    assert rest == b""
    np.testing.assert_array_equal(found.theta, theta)
    np.testing.assert_array_equal(found.a, a)
    np.testing.assert_array_equal(found.d, d)
    np.testing.assert_array_equal(found.alpha, alpha)
    assert difference(np.zeros((1, 6)), UR5E.dh, found).max_mm < 1e-6


def test_who_does_not_tell_them_is_not_asked_for_ever(emulators):
    assert read_kinematics("127.99.99.98", 0.2) is None
    assert read_kinematics(emulators("--mute").host, 0.2) is None


def test_nonsense_on_the_port_is_nothing(emulator):
    host = emulator.host
    emulator.close()
    with socket.create_server((host, rtde.PORT_PRIMARY)) as server:

        def serve():
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"\xff" * 100)

        thread = threading.Thread(target=serve)
        thread.start()
        assert read_kinematics(host, 1.0) is None
        thread.join()
