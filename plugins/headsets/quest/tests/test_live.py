"""The live route, with the emulated logger and a made-up adb."""

import os
import secrets
import socket
import struct
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from vrbench_quest import wire
from vrbench_quest.emulator import Logger, play
from vrbench_quest.route import HEADSET, Options, QuestLogger, check
from vrbench_quest.vrbench_log import IMPORTER, LogOptions

from vrbench.devices.host import RealClock
from vrbench.devices.ports import Session
from vrbench.errors import DeviceError
from vrbench.geometry import Transform, unity_to_openxr

TOKEN = "0123456789abcdef"
PAST_ALL_TIMES = wire.PONG_BODY.pack(1, 2**63 - 1, 2**63 - 1)


def session():
    return Session(RealClock(), Transform.identity(), seed=0)


def wait_for(condition, seconds=10.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "what was waited for did not come"
        time.sleep(0.01)


def events_of(columns, kind):
    return [event.detail for event in columns.events if event.kind == kind]


def lost(columns):
    """Gaps in what was numbered; a busy computer pauses, and loses nothing by that."""
    return [gap for gap in events_of(columns, "gap") if gap["kind"] == "sequence"]


@pytest.fixture
def route():
    options = Options(listen="127.0.0.1:0", token=TOKEN, adb=False, quiet=True)
    headset = QuestLogger(options, None, session())
    headset.listen()
    yield headset
    headset.__exit__(None, None, None)


@pytest.fixture
def logger(route, tmp_path):
    """The emulated logger, playing in a thread until the test ends."""
    made = Logger("127.0.0.1", route.receiver.port, TOKEN, folder=tmp_path)
    over = threading.Event()
    thread = threading.Thread(target=play, args=(made, 72.0, lambda: not over.is_set()))
    thread.start()
    wait_for(lambda: route.missing is None)
    yield made
    over.set()
    thread.join()
    made.close()


def record(route, seconds=0.5):
    route.start("replay.default.m1.r1")
    time.sleep(seconds)
    route.stop()
    return route.read()


def test_poses_arrive_as_they_were_sent_and_none_is_missing(route, logger):
    columns = record(route)
    samples = columns.poses["headset/eye"]
    sent = {t: (p, q) for t, p, q in logger.sent}
    assert len(samples) > 20
    assert samples.good.all()
    times = (samples.source_t - 1_700_000_000_000_000_000).tolist()
    unity = Transform(
        np.array([sent[t][0] for t in times], float), np.array([sent[t][1] for t in times], float)
    )
    eye = unity_to_openxr(unity)
    np.testing.assert_array_equal(samples.pose.p, eye.p)
    np.testing.assert_allclose(samples.pose.q, eye.q, atol=1e-7)
    assert not lost(columns)
    assert len(columns.clocks["headset"]) > 3
    (facts,) = events_of(columns, "headset")
    assert facts["model"] == "emulated Quest"
    assert facts["moment"] == "render"
    assert -20e6 < np.median(samples.receive_t - samples.pose_t) < 500e6


def test_the_log_on_the_headset_is_the_take_that_was_sent(route, logger, tmp_path):
    samples = record(route).poses["headset/eye"]
    wait_for(lambda: list(tmp_path.glob("*.csv")))
    (path,) = tmp_path.glob("replay.default.m1.r1.*.csv")
    log = IMPORTER.read(path, LogOptions()).samples
    t = log.pose_t.tolist()
    first = t.index(int(samples.source_t[0]))
    part = log[first : first + len(samples)]
    np.testing.assert_array_equal(part.pose_t, samples.source_t)
    # as short as float32 is exact
    np.testing.assert_allclose(part.pose.p, samples.pose.p, atol=1e-7)


def test_one_session_lives_through_many_takes(route, logger):
    for _ in range(2):
        route.start("take")
        time.sleep(0.3)
        route.stop()
        columns = route.read()
        assert columns.poses["headset/eye"].good.all()
        assert not lost(columns)
        assert route.read().poses == {}


def test_a_recentre_starts_an_epoch_and_poor_tracking_is_no_good_pose(route, logger):
    route.start("take")
    time.sleep(0.2)
    logger.epoch += 1
    logger.tell("reset")
    time.sleep(0.2)
    logger.flags = 7
    time.sleep(0.2)
    route.stop()
    columns = route.read()
    samples = columns.poses["headset/eye"]
    assert set(samples.epoch.tolist()) == {0, 1}
    assert events_of(columns, "recentre") == [{"epoch": 1}]
    assert events_of(columns, "reset")
    assert set(samples.flags[~samples.good].tolist()) == {7}


def test_datagrams_that_are_lost_are_counted(route, logger):
    route.start("take")
    time.sleep(0.2)
    logger.lose = 3
    time.sleep(0.3)
    route.stop()
    columns = route.read()
    (gap,) = [x for x in events_of(columns, "gap") if x["kind"] == "sequence"]
    assert gap["missing"] == 6  # two samples in each


def test_a_clock_that_jumps_is_told(route, logger):
    route.start("take")
    time.sleep(0.5)
    logger.shift_ns += 700_000_000
    time.sleep(1.0)
    route.stop()
    columns = route.read()
    samples = columns.poses["headset/eye"]
    assert [x for x in events_of(columns, "clock") if x["state"] == "lost"]
    delay = samples.receive_t - samples.pose_t
    assert np.all(np.abs(delay[samples.good]) < 600e6)
    assert not samples.good.all()
    assert samples.good[-10:].all()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "a datagram of 0 bytes"),
        (b"x" * 1500, "a datagram of 1500 bytes"),
        (b"GET / HTTP/1.1\r\n\r\n", "something else"),
        (wire.MAGIC + b"\x09" * 20, "a logger of version 9"),
        (wire.pack(wire.HELLO, b"8 bytes!"), "without the token"),
        (wire.pack(wire.HELLO, bytes.fromhex(TOKEN), b"{}"), "without the name of its run"),
        (wire.pack(wire.HELLO, bytes.fromhex(TOKEN), b"[" * 1300), "no JSON"),
        (wire.pack(wire.PONG, bytes.fromhex(TOKEN), b"12"), "a datagram of 2 bytes"),
        (wire.pack(99, bytes.fromhex(TOKEN)), "a datagram of kind 99"),
        (wire.pack(wire.PONG, bytes.fromhex(TOKEN), PAST_ALL_TIMES), "a time of 92233720368547"),
        (
            wire.pack(wire.EVENT, bytes.fromhex(TOKEN), wire.EVENT_BODY.pack(9, -(2**63))),
            "a time of -92233720368547",
        ),
        (
            wire.pack(wire.HELLO, bytes.fromhex(TOKEN), b'{"run": "a", "x": NaN}'),
            "a greeting that is no JSON",
        ),
        (
            wire.pack(wire.HELLO, bytes.fromhex(TOKEN), b'{"run": "\\ud800"}'),
            "a greeting that is no JSON",
        ),
    ],
    ids=lambda x: str(x)[:24],
)
def test_datagrams_of_another_shape_are_told_and_do_no_harm(route, logger, data, says):
    route.start("take")
    logger.send_raw(data)
    time.sleep(0.3)
    route.stop()
    columns = route.read()
    assert any(says in x["why"] for x in events_of(columns, "refused"))
    assert columns.poses["headset/eye"].good.all()
    assert not lost(columns)


@pytest.mark.parametrize(
    "body",
    [
        b"",
        wire.BATCH.pack(0, 0),
        wire.BATCH.pack(0, 3) + b"x" * 68,
        wire.BATCH.pack(0, 1) + b"\xff" * wire.POSE.itemsize,
        wire.BATCH.pack(0, 1) + struct.pack("<q", -(2**63)) + bytes(wire.POSE.itemsize - 8),
    ],
)
def test_poses_of_another_shape_are_refused(body):
    with pytest.raises(wire.WireError):
        wire.poses_of(body)


def test_any_datagram_is_understood_or_refused():
    rng = np.random.default_rng(3)
    good = wire.pack(wire.HELLO, bytes(8), b'{"run": "a"}')
    for _ in range(2000):
        data = bytearray(good if rng.random() < 0.5 else rng.bytes(rng.integers(0, 120)))
        for _ in range(rng.integers(0, 3)):
            if data:
                data[rng.integers(len(data))] = rng.integers(256)
        try:
            datagram = wire.unpack(bytes(data))
            wire.facts_of(datagram.body)
            wire.poses_of(datagram.body)
        except wire.WireError:
            continue


def test_a_second_sender_is_refused_even_with_the_token(route, logger):
    route.start("take")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        hello = wire.pack(wire.HELLO, bytes.fromhex(TOKEN), b'{"run": "other"}')
        other.sendto(hello, ("127.0.0.1", route.receiver.port))
        time.sleep(0.3)
    route.stop()
    columns = route.read()
    assert events_of(columns, "refused") == [{"why": "a second sender, 127.0.0.1"}]
    assert columns.poses["headset/eye"].good.all()


def test_a_logger_that_falls_silent_is_told_and_the_next_take_refused(route, monkeypatch):
    monkeypatch.setattr("vrbench_quest.receiver.SILENT_NS", 400_000_000)
    monkeypatch.setattr("vrbench_quest.route.ANSWER_S", 0.3)
    made = Logger("127.0.0.1", route.receiver.port, TOKEN)
    end = time.monotonic() + 0.8
    play(made, 72.0, lambda: route.missing is not None and time.monotonic() < end + 5)
    starting = threading.Thread(target=play, args=(made, 72.0, lambda: time.monotonic() < stop_at))
    stop_at = time.monotonic() + 0.6
    starting.start()
    route.start("take")
    starting.join()
    time.sleep(0.6)
    route.stop()
    columns = route.read()
    assert {"state": "lost", "why": "the logger is silent"} in events_of(columns, "connection")
    assert [x for x in events_of(columns, "gap") if x["kind"] == "end"]
    with pytest.raises(DeviceError, match="no logger is heard"):
        route.start("next")
    made.close()


def test_the_emulator_runs_as_a_process_of_its_own(route, tmp_path):
    words = ["--port", str(route.receiver.port), "--token", TOKEN, "--folder", str(tmp_path)]
    process = subprocess.Popen([sys.executable, "-m", HEADSET.emulator, *words])
    try:
        wait_for(lambda: route.missing is None, 20.0)
        assert record(route, 0.3).poses["headset/eye"].good.all()
    finally:
        process.terminate()
        process.wait(10)


def test_a_port_in_use_is_named(route):
    options = Options(listen=f"127.0.0.1:{route.receiver.port}", adb=False, quiet=True)
    with pytest.raises(DeviceError, match=r"can't listen at 127\.0\.0\.1"):
        QuestLogger(options, None, session()).__enter__()


# By cable.

ADB = r"""#!/bin/sh
[ "$1" = -s ] && shift 2
case "$*" in
  devices) printf 'List of devices attached\n'; printf "$DEVICES" ;;
  *ro.product.model*) echo 'Quest 3' ;;
  *ro.build.display.id*) echo 'v76.1' ;;
  *debug.oculus.refreshRate*) echo 90 ;;
  *'dumpsys battery'*) printf '  level: %s\n  temperature: 312\n' "$LEVEL" ;;
  *'dumpsys thermalservice'*) printf 'IsStatusOverride: false\nThermal Status: %s\n' "$THERMAL" ;;
  *prox_close*|*'am start'*) echo "$*" >> "$ADB_LOG" ;;
  *'ls /sdcard'*) ls "$FILES" ;;
  pull*) cp "$FILES/$(basename "$2")" "$3" ;;
  *) echo "unknown: $*" >&2; exit 1 ;;
esac
"""


@pytest.fixture
def adb(tmp_path, monkeypatch):
    """A made-up adb on the PATH; the test says what the device tells."""
    folder, files = tmp_path / "bin", tmp_path / "files"
    folder.mkdir()
    files.mkdir()
    (folder / "adb").write_text(ADB)
    (folder / "adb").chmod(0o755)
    told = {
        "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}",
        "DEVICES": "1WMHH000X00000\tdevice\n",
        "LEVEL": "88",
        "THERMAL": "0",
        "ADB_LOG": str(tmp_path / "adb.log"),
        "FILES": str(files),
    }
    for name, value in told.items():
        monkeypatch.setenv(name, value)
    return tmp_path


def found(**options):
    made = Options(listen="127.0.0.1:0", quiet=True, wait_s=0.1, **options)
    return list(check(made, session()))


def test_rig_check_tells_of_the_headset_and_that_the_logger_is_not_heard(adb):
    *by_cable, logger = found(mannequin=True)
    assert all(finding.ok for finding in by_cable)
    told = "; ".join(finding.what for finding in by_cable)
    for part in ("Quest 3 1WMHH000X00000", "v76.1", "proximity", "90 Hz", "88 %, 31.2 C", "none"):
        assert part in told
    assert not logger.ok
    assert logger.what == "no logger is heard"
    done = (adb / "adb.log").read_text()
    assert "com.oculus.vrpowermanager.prox_close" in done
    assert "am start -n org.vrbench.logger/" in done
    assert "vrbench_token" in done


def test_rig_check_leaves_the_sensor_alone_unless_asked(adb):
    found()
    assert "prox_close" not in (adb / "adb.log").read_text()


@pytest.mark.parametrize(
    ("name", "value", "what", "fix"),
    [
        ("DEVICES", "", "no device is attached by adb", "allow USB debugging"),
        ("DEVICES", "1WM\tunauthorized\n", "1WM is unauthorized", "allow USB debugging"),
        ("DEVICES", "1WM\tdevice\n2WM\tdevice\n", "2 devices are attached: 1WM, 2WM", "which"),
        ("LEVEL", "12", "battery 12 %, 31.2 C", "charge it"),
        ("THERMAL", "3", "thermal state: severe", "let it cool"),
    ],
)
def test_what_is_wrong_by_cable_is_said_with_what_to_do(adb, monkeypatch, name, value, what, fix):
    monkeypatch.setenv(name, value)
    (bad,) = [finding for finding in found() if not finding.ok and "logger" not in finding.what]
    assert bad.what == what
    assert fix in bad.fix


def test_that_there_is_no_adb_is_said(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    (only,) = found()
    assert not only.ok
    assert only.what == "adb is not here"
    assert "platform tools" in only.fix


def test_an_adb_that_fails_gives_its_reason(adb):
    (adb / "bin" / "adb").write_text("#!/bin/sh\necho 'daemon not running' >&2\nexit 1\n")
    (only,) = found()
    assert only.what == "adb devices: daemon not running"


def test_the_log_of_a_take_is_copied_and_battery_is_told_before_and_after(adb):
    options = Options(listen="127.0.0.1:0", token=TOKEN, quiet=True, pull=adb / "logs", wait_s=10.0)
    headset = QuestLogger(options, None, session())
    headset.listen()
    made = Logger("127.0.0.1", headset.receiver.port, TOKEN, folder=adb / "files")
    over = threading.Event()
    thread = threading.Thread(target=play, args=(made, 72.0, lambda: not over.is_set()))
    thread.start()
    try:
        wait_for(lambda: headset.missing is None)
        columns = record(headset, 0.3)
    finally:
        over.set()
        thread.join()
        made.close()
        headset.__exit__(None, None, None)
    (log,) = headset.pulled
    assert len(IMPORTER.read(log, LogOptions()).samples) > 5
    state = {"battery_percent": 88, "thermal": "none"}
    assert state.items() <= events_of(columns, "headset")[0].items()
    assert events_of(columns, "headset-after") == [state]


def test_entering_without_a_device_says_so_and_leaves_nothing_open(adb, monkeypatch):
    monkeypatch.setenv("DEVICES", "")
    options = Options(listen="127.0.0.1:0", quiet=True)
    with (
        pytest.raises(DeviceError, match="no device is attached"),
        QuestLogger(options, None, session()),
    ):
        pass


def test_tokens_are_drawn_anew():
    tokens = {QuestLogger(Options(), None, session()).token for _ in range(3)}
    assert len(tokens) == 3
    assert all(len(token) == len(secrets.token_hex(8)) for token in tokens)
