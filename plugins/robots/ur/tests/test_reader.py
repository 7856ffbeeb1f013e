import contextlib
import socket
import threading
import time

import numpy as np
import pytest
from vrbench_ur import rtde
from vrbench_ur.controller_clock import ControllerClock
from vrbench_ur.probe import Dashboard
from vrbench_ur.reader import Reader
from vrbench_ur.testing import wait_until

from vrbench.errors import DeviceError


def test_no_sample_is_lost_at_500_hz(emulator):
    with Reader(emulator.host, 500.0, time.time_ns) as reader:
        wait_until(lambda: reader.received > 1500)
        time.sleep(0.3)  # nobody reads meanwhile
        times, packets = reader.take()
    assert len(packets) == len(times) >= 1500
    np.testing.assert_allclose(np.diff(packets["timestamp"]), 0.002, atol=1e-9)
    assert reader.overflowed == 0
    assert (np.diff(times) >= 0).all()


def test_reading_returns_at_once_and_only_what_is_new(emulator):
    with Reader(emulator.host, 125.0, time.time_ns) as reader:
        wait_until(lambda: reader.received > 20)
        first = reader.take()[1]["timestamp"]
        wait_until(lambda: reader.received > 40)
        second = reader.take()[1]["timestamp"]
    assert second[0] > first[-1]
    np.testing.assert_allclose(np.diff(np.concatenate((first, second))), 0.008, atol=1e-9)


def test_nobody_there(emulator):
    with pytest.raises(DeviceError, match="no controller answers"):
        Reader("127.99.99.99", 500.0, time.time_ns, 0.5)


def test_a_host_that_accepts_and_stays_mute_is_an_error_in_time(emulators):
    with pytest.raises(DeviceError, match="stays mute"):
        Reader(emulators("--mute").host, 500.0, time.time_ns, 0.3)


def test_what_is_no_robot_is_told(emulator):
    host = emulator.host
    emulator.close()
    with socket.create_server((host, rtde.PORT_RTDE)) as server:

        def serve():
            connection, _ = server.accept()
            with connection:
                connection.recv(100)
                connection.sendall(b"HTTP/1.0 400 Bad Request\r\n\r\n")

        thread = threading.Thread(target=serve)
        thread.start()
        with pytest.raises(DeviceError, match="does not speak RTDE"):
            Reader(host, 500.0, time.time_ns, 1.0)
        thread.join()


@pytest.mark.parametrize(
    ("port", "bytes_at_once", "match"),
    [
        (rtde.PORT_DASHBOARD, b"x", "mute"),
        (rtde.PORT_DASHBOARD, b"HTTP/1.1 400 Bad Request\r\n", "no dashboard"),
        (rtde.PORT_RTDE, rtde.message(rtde.TEXT, b"hello"), "mute"),
    ],
)
def test_who_talks_without_answering_is_an_error_in_time(emulator, port, bytes_at_once, match):
    host = emulator.host
    emulator.close()
    over = threading.Event()
    with socket.create_server((host, port)) as server:

        def serve():
            connection, _ = server.accept()
            with connection, contextlib.suppress(OSError):
                while not over.wait(0.05):
                    connection.sendall(bytes_at_once)

        thread = threading.Thread(target=serve)
        thread.start()
        with pytest.raises(DeviceError, match=match):
            if port == rtde.PORT_RTDE:
                Reader(host, 500.0, time.time_ns, 0.5)
            else:
                Dashboard(host, 0.5)
        over.set()
        thread.join()


def test_a_drop_keeps_what_came_before_and_is_known(emulator):
    with Reader(emulator.host, 500.0, time.time_ns) as reader:
        wait_until(lambda: reader.received > 100)
        emulator.tell("drop")
        wait_until(lambda: reader.lost)
        assert len(reader.take()[0]) >= 100


def test_a_freeze_counts_as_a_loss_when_it_outlasts_the_timeout(emulator):
    with Reader(emulator.host, 500.0, time.time_ns, 0.4) as reader:
        wait_until(lambda: reader.received > 10)
        emulator.tell("freeze 1.0")
        assert "nothing came" in wait_until(lambda: reader.lost)


def test_packets_the_controller_skips_are_missing_and_no_others(emulator):
    with Reader(emulator.host, 500.0, time.time_ns) as reader:
        wait_until(lambda: reader.received > 50)
        emulator.tell("skip 20")
        seen = reader.received
        wait_until(lambda: reader.received > seen + 200)
        _, packets = reader.take()
    steps = np.diff(packets["timestamp"])
    assert (steps > 0.003).sum() == 1
    assert steps.max() == pytest.approx(0.042, abs=1e-6)


def framed():
    return rtde.message(rtde.DATA, b"abc") + rtde.message(rtde.TEXT, b"")


@pytest.mark.parametrize("cut", range(1, 9))
def test_messages_are_whole_however_the_stream_is_cut(cut):
    framing, data = rtde.Framing(), framed()
    got = [*framing.feed(data[:cut]), *framing.feed(data[cut:])]
    assert got == [(rtde.DATA, b"abc"), (rtde.TEXT, b"")]


def test_sizes_that_no_message_has_are_refused():
    with pytest.raises(ValueError, match="2 bytes"):
        list(rtde.Framing().feed(b"\x00\x02\x55"))


def test_the_controllers_clock_is_mapped_through_late_packets_and_drift():
    rng = np.random.default_rng(1)
    device = np.arange(0, 60_000_000_000, 2_000_000, dtype=np.int64)
    true = device + 1_700_000_000_000_000_000 + (device * 40e-6).astype(np.int64)
    received = true + 100_000 + rng.exponential(300_000, len(device)).astype(np.int64)
    received = np.maximum.accumulate(received)
    clock = ControllerClock()
    parts = [
        clock.to_host(device[i : i + 50], received[i : i + 50]) for i in range(0, len(device), 50)
    ]
    host = np.concatenate(parts)
    assert (np.diff(host) > 0).all()
    # a tenth of a millisecond is the least delay; the rest of the error is the map's
    error = (host - true)[len(host) // 6 :] / 1e6
    assert np.abs(error - 0.1).max() < 0.15
