import socket
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
