"""The source on an emulated Motive, over loopback."""

import socket
import time

import numpy as np
import pytest
from vrbench_optitrack import check, client
from vrbench_optitrack.client import OPTITRACK, OptiTrack, topic_name
from vrbench_optitrack.clock import TickClock
from vrbench_optitrack.encode import encode_frame
from vrbench_optitrack.frame import Frame, RigidBody, Suffix
from vrbench_optitrack.link import discover
from vrbench_optitrack.rows import Row
from vrbench_optitrack.scene import MARKERS, Scene

from vrbench.errors import DeviceError
from vrbench.geometry import relative_angle
from vrbench.streams import Columns

SCENE = Scene(motion="saturate-30s-1", begin_s=10.0)


def record(source, seconds=0.4):
    """All that a take of so many seconds holds."""
    source.start("take")
    parts = []
    for _ in range(5):
        time.sleep(seconds / 5)
        parts.append(source.read())
    source.stop()
    parts.append(source.read())
    return parts


def samples_of(parts, stream="mocap/headset"):
    found = [part.poses[stream] for part in parts if stream in part.poses]
    return type(found[0]).concatenate(found)


def events_of(parts, kind):
    return [event for part in parts for event in part.events if event.kind == kind]


def true_head(motive, t):
    return SCENE.head((t - motive.first_frame_ns) / 1e9)


@pytest.mark.parametrize(
    ("version", "way"),
    [
        ("2.9", "multicast"),
        ("2.10", "unicast"),
        ("3.0", "unicast"),
        ("3.1", "multicast"),
        ("4.0", "unicast"),
        ("4.1", "multicast"),
        ("4.2", "unicast"),
    ],
)
def test_poses_are_where_the_head_was_at_mid_exposure(motive, session, options, version, way):
    server = motive("--version", version, f"--{way}", "--rate", 500)
    more = {"connection": way, "data_port": server.data_port} if version < "3" else {}
    with OptiTrack(options(server, **more), session) as source:
        parts = record(source)
    samples = samples_of(parts)
    assert samples.good.all()
    assert len(samples) > 50
    # before NatNet 3 there is nothing better than the arrival, 6.25 ms late and more
    old = version.startswith("2")
    (told,) = events_of(parts, "pose-time")
    assert told.detail["from"] == ("arrival" if old else "mid-exposure")
    truth = true_head(server, samples.pose_t)
    errors = np.linalg.norm(samples.pose.p - truth.p, axis=1)
    assert np.median(errors) < (0.02 if old else 2e-4)
    assert np.median(relative_angle(samples.pose.q, truth.q)) < (0.05 if old else 1e-3)
    assert np.all(np.diff(samples.pose_t) > 0)
    assert np.all(samples.receive_t >= samples.pose_t)
    (shape,) = events_of(parts, "body")
    np.testing.assert_allclose(shape.detail["markers_mm"], MARKERS * 1e3, atol=0.01)
    if not old:
        assert len(parts[0].clocks["optitrack"]) > 0
        delay = np.median(samples.receive_t - samples.pose_t) / 1e6
        assert delay > 6.0


@pytest.mark.parametrize(("up", "unit_mm"), [("z", 1000.0), ("y", 1.0), ("z", 25.4)])
def test_axes_and_units_are_converted_at_the_border(motive, session, options, up, unit_mm):
    server = motive("--up", up, "--unit-mm", unit_mm)
    with OptiTrack(options(server, up=up), session) as source:
        parts = record(source)
    samples = samples_of(parts)
    truth = true_head(server, samples.pose_t)
    assert np.median(np.linalg.norm(samples.pose.p - truth.p, axis=1)) < 2e-4
    assert np.median(relative_angle(samples.pose.q, truth.q)) < 1e-3
    (shape,) = events_of(parts, "body")
    np.testing.assert_allclose(shape.detail["markers_mm"], MARKERS * 1e3, atol=0.01)


@pytest.mark.parametrize(
    ("stamps", "name", "late_ms"),
    [("received", "data-received", 7.0), ("transmit", "transmit", 10.0), ("none", "arrival", 10.0)],
)
def test_without_mid_exposure_the_next_best_time_is_used_and_told(
    motive, session, options, stamps, name, late_ms
):
    server = motive("--stamps", stamps, "--latency-ms", 10)
    with OptiTrack(options(server), session) as source:
        parts = record(source)
    samples = samples_of(parts)
    (told,) = events_of(parts, "pose-time")
    assert told.detail == {"stream": "mocap/headset", "from": name}
    index = np.rint((samples.pose_t - server.first_frame_ns) / 1e9 * 240.0 - late_ms * 0.24)
    exposed = server.first_frame_ns + index / 240.0 * 1e9
    assert np.median(samples.pose_t - exposed) / 1e6 == pytest.approx(late_ms, abs=1.5)


@pytest.mark.parametrize("lost_as", ["flag", "absent"])
@pytest.mark.parametrize("version", ["2.5", "2.9", "4.1"])
def test_a_body_that_is_lost_is_invalid_and_not_a_frozen_pose(
    motive, session, options, lost_as, version
):
    lost = ("--lose-every", 0.4, "--lose-for", 0.2, "--lost-as", lost_as)
    server = motive("--version", version, "--unicast", *lost)
    with OptiTrack(options(server, connection="unicast"), session) as source:
        samples = samples_of(record(source, 1.0))
    assert 0.15 < samples.good.mean() < 0.85
    assert np.isfinite(samples.pose.p).all()
    np.testing.assert_allclose(np.linalg.norm(samples.pose.q, axis=1), 1.0, atol=1e-6)
    good = samples.pose.p[samples.good]
    assert np.all(np.linalg.norm(np.diff(good, axis=0), axis=1) > 0)


@pytest.mark.parametrize("by_s", [0.005, -1000.0])
def test_no_good_pose_has_a_time_of_a_clock_that_has_stepped(motive, session, options, by_s):
    server = motive("--rate", 250, "--step-after", 1.5, "--step-by", by_s)
    with OptiTrack(options(server), session) as source:
        time.sleep(max(0.0, server.first_frame_ns / 1e9 + 1.2 - time.monotonic()))
        parts = record(source, 1.0)
    samples = samples_of(parts)
    (step,) = events_of(parts, "clock-step")
    assert step.detail["by_s"] == pytest.approx(by_s, abs=0.002)
    good = samples[samples.good]
    away = np.linalg.norm(good.pose.p - true_head(server, good.pose_t).p, axis=1)
    assert away.max() < 1e-3
    assert 0 < np.count_nonzero(~samples.good) < len(samples) / 2
    np.testing.assert_array_equal(samples.pose_t[~samples.good], samples.receive_t[~samples.good])


def test_frames_that_never_come_are_counted(motive, session, options):
    server = motive("--drop", 0.2, "--rate", 500)
    with OptiTrack(options(server), session) as source:
        parts = record(source, 1.0)
    lost = sum(event.detail["frames"] for event in events_of(parts, "gap"))
    assert lost / (lost + len(samples_of(parts))) == pytest.approx(0.2, abs=0.08)


def test_the_body_is_followed_when_its_streaming_id_changes(motive, session, options):
    server = motive("--new-id-after", 1.0)
    with OptiTrack(options(server), session) as source:
        source.start("take")
        while time.monotonic_ns() < server.first_frame_ns + 1.7e9:
            time.sleep(0.05)
        source.stop()
        parts = [source.read()]
    samples = samples_of(parts)
    assert samples.good[-20:].all()
    assert samples.good.mean() > 0.8
    assert [event.detail["id"] for event in events_of(parts, "body")][-1] == 41


@pytest.mark.parametrize(("before", "after"), [("4.1", "3.1"), ("3.1", "4.1")])
def test_a_bitstream_that_changes_is_followed_by_a_new_handshake(
    motive, session, options, before, after
):
    server = motive("--version", before, "--switch-after", 1.2, "--switch-to", after)
    with OptiTrack(options(server), session) as source:
        source.start("take")
        while time.monotonic_ns() < server.first_frame_ns + 2.2e9:
            time.sleep(0.05)
        source.stop()
        parts = [source.read()]
    samples = samples_of(parts)
    assert samples.good[-20:].all()
    assert samples.receive_t[-1] > server.first_frame_ns + 2e9
    told = [event.detail["natnet"] for event in events_of(parts, "server")]
    assert told[0] == before
    assert after in told


def test_the_bitstream_that_is_asked_for_is_streamed(motive, session, options):
    server = motive("--version", "4.2")
    with OptiTrack(options(server, bitstream="3.0"), session) as source:
        parts = record(source)
    assert events_of(parts, "server")[0].detail["natnet"] == "3.0"
    assert samples_of(parts).good.all()


def test_a_client_that_streams_for_long_is_not_forgotten(motive, session, options):
    server = motive("--timeout", 1.2)
    with OptiTrack(options(server), session) as source:
        time.sleep(1.6)
        samples = samples_of(record(source))
    assert samples.good.all()


def test_frames_of_another_sender_are_dropped(motive, session, options):
    server = motive("--multicast")
    body = RigidBody(1, (9.0, 9.0, 9.0), (0.0, 0.0, 0.0, 1.0), 0.0, 1)
    fake = encode_frame(Frame(1, [], [], [body], *[[]] * 5, Suffix(*[0] * 10)), (4, 1))
    with (
        OptiTrack(options(server), session) as source,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as near,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as far,
    ):
        source.start("take")
        for other, address in ((near, "127.0.0.1"), (far, "127.0.0.2")):
            other.bind((address, 0))
            other.setsockopt(
                socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1")
            )
            other.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            for _ in range(20):
                other.sendto(fake, ("239.255.42.99", server.data_port))
        time.sleep(0.3)
        source.stop()
        samples = source.read().poses["mocap/headset"]
    assert np.abs(samples.pose.p).max() < 5.0


def test_a_server_is_found_by_broadcast(motive, session, options):
    server = motive()
    found = discover("127.0.0.1", server.port, session.host, 0.5)
    if not found:
        pytest.skip("loopback has no broadcast here")
    assert [(address, info.application) for address, info in found] == [("127.0.0.1", "Motive")]
    searching = options(server, server=None, interface="127.0.0.1")
    with OptiTrack(searching, session) as source:
        assert samples_of(record(source)).good.all()


def test_a_server_may_be_given_by_name(motive, session, options):
    with OptiTrack(options(motive(), server="localhost"), session) as source:
        assert samples_of(record(source)).good.all()
    nowhere = options(motive(), server="no such computer")
    with pytest.raises(DeviceError, match=r"mocap.options.server: 'no such computer' can't be"):
        OptiTrack(nowhere, session).__enter__()


@pytest.mark.usefixtures("impatient")
def test_what_keeps_a_source_from_opening_is_told(motive, session, options):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody:
        nobody.bind(("127.0.0.1", 0))
        port = nobody.getsockname()[1]
        silent = options(motive("--mute"), command_port=port)
        with pytest.raises(DeviceError, match=r"no answer from 127\.0\.0\.1.*firewall"):
            OptiTrack(silent, session).__enter__()
    with pytest.raises(DeviceError, match=r"no rigid body 'hmd' \(there are 'controller', 'head"):
        OptiTrack(options(motive(), body="hmd"), session).__enter__()
    with pytest.raises(DeviceError, match="can't use the local address 192"):
        OptiTrack(options(motive(), interface="192.0.2.99"), session).__enter__()


def test_a_server_that_falls_silent_is_an_error_and_not_a_hang(motive, session, options):
    server = motive()
    with OptiTrack(options(server, silence_s=0.5), session) as source:
        source.start("take")
        end = time.monotonic() + 5.0
        while not source.read().poses:
            assert time.monotonic() < end
            time.sleep(0.02)
        server.stop()
        with pytest.raises(DeviceError, match=r"has sent no frame|no longer answers|can't send"):
            for _ in range(40):
                time.sleep(0.1)
                source.read()


def test_nothing_is_read_before_the_first_take_or_after_the_last(motive, session, options):
    server = motive()
    with OptiTrack(options(server), session) as source:
        assert source.read() == Columns({}) or not source.read().poses
        source.start("take")
        source.stop()
        time.sleep(0.2)
        source.read()
        time.sleep(0.2)
        assert not source.read().poses


@pytest.fixture
def impatient(monkeypatch):
    """On loopback, answers come at once."""
    for name, seconds in (
        ("ANSWER_S", 0.6),
        ("FRAMES_S", 0.6),
        ("MODELS_S", 0.6),
        ("WATCH_S", 0.4),
    ):
        monkeypatch.setattr(check, name, seconds)
        monkeypatch.setattr(client, name, seconds, raising=False)


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize(
    ("arguments", "more", "says", "fix"),
    [
        (["--mute"], {}, "answers, but sends no frames", "Broadcast Frame Data"),
        (["--mute", "--multicast"], {}, "no frames come by multicast", "IGMP"),
        (["--claim", "3.1"], {}, "wrong version: Motive says NatNet 3.1", "bitstream"),
        ([], {"body": "hmd"}, "no rigid body 'hmd'", "there are 'controller', 'headset'"),
        (["--up", "z"], {}, "z is up in the stream, the rig says y", "`up: z`"),
        ([], {"up": "z"}, "y is up in the stream, the rig says z", "`up: y`"),
        (["--up", "z", "--version", "3.1", "--begin", 0], {}, "z is up in the stream", "up: z"),
        (["--lose-every", 1, "--lose-for", 1], {}, "'headset' is not tracked: Motive says", "view"),
        (
            ["--lose-every", 1, "--lose-for", 1, "--lost-as", "absent"],
            {},
            "not tracked: it isn't in the frames",
            "Motive's asset pane",
        ),
    ],
)
def test_check_tells_what_is_wrong(motive, session, options, arguments, more, says, fix):
    server = motive(*arguments)
    wrong = [f for f in OPTITRACK.check(options(server, **more), session) if not f.ok]
    (finding,) = wrong
    assert says in finding.what
    assert fix in finding.fix


@pytest.mark.parametrize(("said_hz", "ok"), [(None, True), (240.0, True), (360.0, False)])
def test_check_compares_the_rate_with_the_one_that_is_said(said_hz, ok):
    clock = TickClock(1_000_000)
    clock.add((0, 0, 100))
    stamps = [(round(i * 1e6 / 240) + 1, 0, 0) for i in range(100)]
    # arrivals in two bursts, as on a busy computer
    rows = [Row(i // 50 * 10**9, i, s, None, True, clock, True) for i, s in enumerate(stamps)]
    finding = check._rate(rows, 0, said_hz)
    assert finding.ok == ok
    assert finding.what.startswith("240 frames a second, 0.0 % lost")
    assert ("though Motive says 360" in finding.what) == (not ok)


@pytest.mark.usefixtures("impatient")
def test_check_of_a_sound_motive_has_no_complaint(motive, session, options):
    findings = list(OPTITRACK.check(options(motive("--version", "4.2")), session))
    assert [f for f in findings if not f.ok] == []
    assert "Motive 3.1 answers at 127.0.0.1: NatNet 4.2" in findings[0].what
    assert any("up axis: y, as the rig says" in f.what for f in findings)


@pytest.mark.usefixtures("impatient")
def test_check_without_an_answer_names_address_and_firewall(motive, session, options):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody:
        nobody.bind(("127.0.0.1", 0))
        lone = options(motive(), command_port=nobody.getsockname()[1])
        (finding,) = OPTITRACK.check(lone, session)
    assert "no answer from 127.0.0.1" in finding.what
    assert "firewall" in finding.fix


def test_topics_have_names_that_ros_allows():
    assert topic_name("headset") == "headset"
    assert topic_name("My HMD é/2") == "My_HMD___2"
    assert topic_name("2nd") == "_2nd"
