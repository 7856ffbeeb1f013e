"""The route with a scripted page: whatever it does, no crash, and no wrong pose as a good one."""

import contextlib
import json
import threading
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from vrbench_webxr import protocol
from vrbench_webxr.door import HEADERS
from vrbench_webxr.emulator import FakePage, batch, play, sway
from vrbench_webxr.protocol import ProtocolError, parse_batch, parse_text
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from vrbench.errors import DeviceError
from vrbench.recording.recorder import record_take
from vrbench.recording.take import read_take

# A take's borders are as sharp as the clock is known, and a busy machine answers late.
MARGIN_S = 0.06
STILL = ((0.1, 0.2, 0.3), (0.0, 0.0, 0.0, 1.0))


def events_of(columns, kind):
    return [event.detail for event in columns.events if event.kind == kind]


def frames(page, count, *, every_s=0.002, **facts):
    time.sleep(MARGIN_S)
    for _ in range(count):
        page.frame(*STILL, **facts)
        time.sleep(every_s)
    time.sleep(MARGIN_S)


def websocket(headset):
    return headset.url.replace("http", "ws", 1) + "ws"


def get(url, **headers):
    return urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=5)


@pytest.fixture(autouse=True)
def _impatient(monkeypatch):
    """What never comes shall not hold up a test for long."""
    monkeypatch.setattr("vrbench_webxr.route.READY_S", 3.0)
    monkeypatch.setattr("vrbench_webxr.route.LAST_FRAMES_S", 1.5)


# Who may come in.


def test_the_page_comes_with_the_headers_that_isolate_it(headset):
    with get(headset.url) as answer:
        assert answer.status == 200
        assert "Start" in answer.read().decode()
        for name, value in HEADERS.items():
            assert answer.headers[name] == value
    for name in ("page.js", "page.css", "icon.svg"):
        with get(headset.url + name) as answer:
            assert answer.status == 200


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/", 403),
        ("/wrongtoken/", 403),
        ("/wrongtoken/ws", 403),
        ("/{token}", 404),
        ("/{token}/../route.py", 404),
        ("/{token}/%2e%2e/route.py", 404),
        ("/{token}/nothing", 404),
    ],
)
def test_nothing_is_given_away_without_the_token_or_beside_the_page(headset, path, status):
    root, token = headset.url.rstrip("/").rsplit("/", 1)
    with pytest.raises(urllib.error.HTTPError) as caught:
        get(root + path.format(token=token))
    assert caught.value.code == status
    caught.value.close()


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8765", "", "127.0.0.1.evil.example"]
)
def test_a_name_of_somebody_elses_that_points_here_is_refused(headset, host):
    with pytest.raises(urllib.error.HTTPError) as caught:
        get(headset.url, Host=host)
    assert caught.value.code == 421
    caught.value.close()


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://localhost:1"])
def test_a_page_of_another_origin_is_refused(headset, page, origin):
    headset.start("take")
    with (
        pytest.raises(InvalidStatus) as caught,
        connect(websocket(headset), origin=origin, proxy=None),
    ):
        pass
    assert caught.value.response.status_code == 403
    headset.stop()
    assert events_of(headset.read(), "refused") == [{"why": "a page of another origin"}]


def test_a_connection_without_the_token_is_refused(headset):
    address = websocket(headset).replace(headset.url.rsplit("/", 2)[1], "anothertoken")
    with pytest.raises(InvalidStatus) as caught, connect(address, proxy=None):
        pass
    assert caught.value.response.status_code == 403


def test_a_second_client_is_refused_and_the_first_goes_on(headset, page, wait_for):
    headset.start("take")
    second = FakePage(headset.url)
    second.connect()
    wait_for(lambda: second.closed is not None)
    assert second.closed == (protocol.SECOND_CLIENT, "another headset is connected")
    second.disconnect()
    frames(page, 20)
    headset.stop()
    columns = headset.read()
    assert len(columns.poses["headset/eye"]) == 20
    assert columns.poses["headset/eye"].good.all()
    assert events_of(columns, "refused") == [{"why": "another headset is connected"}]


# What may be said.


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ("hello?", "message: Invalid JSON"),
        ("{}", "message: Unable to extract tag"),
        ('{"type": "order"}', "message: Input tag 'order'"),
        ('{"type": "pong", "id": 1e400, "received_ms": 1, "sent_ms": 1}', "pong.id"),
        (
            '{"type": "pong", "id": 99999, "received_ms": 1, "sent_ms": 1}',
            "an answer to ping 99999",
        ),
        (
            '{"type": "pong", "id": 0, "received_ms": 1e13, "sent_ms": 1e13}',
            "pong.received_ms",
        ),
        ('{"type": "state", "session": "yes"}', "state.session"),
        ('{"type": "event", "id": 0, "kind": "explosion", "now_ms": 0}', "event.kind"),
        ("[" * 9000, "message: "),
        ("x" * (protocol.MAX_TEXT_CHARS + 1), "a text message of 16385 characters"),
        (b"", "a batch of 0 bytes"),
        (b"12345", "a batch of 5 bytes"),
        (np.zeros(4).tobytes(), "a batch of version 0"),
        (np.array([1.0, 0, 2, 18]).tobytes(), "2 frames in 32 bytes"),
        (np.array([1.0, -1, 1, 18, *[0] * 18]).tobytes(), "sequence number -1"),
        (np.array([1.0, 0.5, 1, 18, *[0] * 18]).tobytes(), "sequence number 0.5"),
        (np.array([1.0, np.nan, 1, 18, *[0] * 18]).tobytes(), "sequence number nan"),
        (np.array([1.0, 0, 1, 17, *[0] * 17]).tobytes(), "17 columns"),
        (batch(0, np.full((1, 18), np.nan)), "a frame without its times"),
        (batch(0, np.full((1, 18), 1e13)), "a frame without its times"),
        (batch(0, np.array([[0.0] * 16 + [16, 0]])), "flags or epoch"),
        (batch(0, np.array([[0.0] * 16 + [15, -1]])), "flags or epoch"),
        (batch(0, np.array([[0.0] * 16 + [15, 0.5]])), "flags or epoch"),
    ],
    ids=lambda x: str(x)[:30],
)
def test_a_message_of_another_shape_is_refused_and_the_recorder_goes_on(
    headset, page, wait_for, data, says
):
    headset.start("take")
    frames(page, 5)
    wait_for(lambda: headset.link.acknowledged[0] == page.next)
    page.send_raw(data)
    wait_for(lambda: page.closed is not None)
    assert page.closed[0] == protocol.BAD_MESSAGE
    assert says in page.closed[1]
    page.disconnect()
    page.connect()
    page.begin_session()
    frames(page, 5)
    headset.stop()
    columns = headset.read()
    assert any(says in detail["why"] for detail in events_of(columns, "refused"))
    samples = columns.poses["headset/eye"]
    assert len(samples) == 10
    np.testing.assert_array_equal(samples.pose.p, [STILL[0]] * 10)


def test_a_message_too_large_closes_the_connection(headset, page, wait_for):
    headset.start("take")
    page.send_raw(b"\0" * (protocol.MAX_MESSAGE_BYTES + 8))
    wait_for(lambda: page.closed is not None)
    assert page.closed[0] == 1009
    headset.stop()
    assert events_of(headset.read(), "connection")[0]["state"] == "lost"


@pytest.mark.parametrize(
    ("first", "code"),
    [
        (b"123", protocol.BAD_MESSAGE),
        ("{}", protocol.BAD_MESSAGE),
        (json.dumps({"type": "state", "session": True}), protocol.BAD_MESSAGE),
        (
            json.dumps({"type": "hello", "protocol": 2, "page": "12345678", "origin_ms": 0}),
            protocol.OTHER_VERSION,
        ),
        (
            json.dumps({"type": "hello", "protocol": 1, "page": "12345678", "origin_ms": 1e14}),
            protocol.BAD_MESSAGE,
        ),
    ],
)
def test_who_does_not_introduce_itself_is_sent_away(headset, first, code):
    with connect(websocket(headset), proxy=None) as socket:
        socket.send(first)
        with pytest.raises(ConnectionClosed):
            socket.recv(timeout=5)
        assert socket.protocol.close_code == code
    assert headset.server.hello is None


@given(st.binary(max_size=400) | st.text(max_size=200))
def test_any_message_is_understood_or_refused(data):
    with contextlib.suppress(ProtocolError):
        parse_batch(data) if isinstance(data, bytes) else parse_text(data)


# Frames.


def test_poses_times_and_flags_arrive_as_they_were_sent(headset, page):
    headset.start("take")
    time.sleep(MARGIN_S)
    sent = []
    for k in range(40):
        p, q = sway(0.1 * k)
        page.frame(p, q, display_ms=25.0)
        sent.append((p, q))
        time.sleep(0.005)
    time.sleep(MARGIN_S)
    headset.stop()
    columns = headset.read()
    samples = columns.poses["headset/eye"]
    np.testing.assert_array_equal(samples.pose.p, [p for p, _ in sent])
    np.testing.assert_allclose(samples.pose.q, [q for _, q in sent], atol=1e-15)
    assert samples.good.all()
    ahead = samples.pose_t - columns.joints["headset/frames"].t
    np.testing.assert_allclose(ahead, 25e6, atol=2e5)
    assert columns.joints["headset/frames"].names[:3] == ("callback_ms", "display_ms", "now_ms")
    assert np.all(np.diff(samples.source_t) > 0)
    # its origin is in 2023 and it has run for hours: its own times are kept as they are
    assert np.all(np.abs(samples.source_t - samples.pose_t) > 10**12)


def test_frames_before_and_after_a_take_do_not_belong_to_it(headset, page):
    frames(page, 10)
    headset.start("take")
    frames(page, 7)
    headset.stop()
    frames(page, 10)
    assert len(headset.read().poses["headset/eye"]) == 7
    time.sleep(0.2)
    assert headset.read().poses == {}


@pytest.mark.parametrize(
    ("p", "q", "flags"),
    [
        ((np.nan, 0, 0), (0, 0, 0, 1), 5),
        ((0, np.inf, 0), (0, 0, 0, 1), 5),
        ((0, 0, 0), (0, 0, 0, 0), 10),
        ((0, 0, 0), (1, 1, 1, 1), 10),
        ((0, 0, 0), (np.nan, 0, 0, 1), 10),
        ((0, 0, 0), (1e200, 1e200, 0, 0), 10),
        ((np.nan,) * 3, (np.nan,) * 4, 0),
    ],
)
def test_what_is_no_pose_is_never_a_good_one(headset, page, p, q, flags):
    headset.start("take")
    time.sleep(MARGIN_S)
    page.frame(p, q)
    page.frame(*STILL)
    time.sleep(MARGIN_S)
    headset.stop()
    samples = headset.read().poses["headset/eye"]
    assert samples.flags.tolist() == [flags, 15]
    assert np.isfinite(samples.pose.p).all()
    np.testing.assert_allclose(np.linalg.norm(samples.pose.q, axis=1), 1.0)


def test_frames_that_the_page_lost_are_told(headset, page, wait_for):
    headset.start("take")
    frames(page, 5)
    time.sleep(0.3)
    page.answers = False
    time.sleep(0.2)
    frames(page, 9)
    page.lose_frames(4)
    page.answers = True
    frames(page, 5)
    headset.stop()
    columns = headset.read()
    assert len(columns.poses["headset/eye"]) == 15
    (gap,) = [x for x in events_of(columns, "gap") if x["kind"] == "sequence"]
    assert gap["missing"] == 4


def test_frames_sent_twice_are_taken_once(headset, page):
    headset.start("take")
    frames(page, 5)
    time.sleep(0.3)
    rows = np.array([[page.now_ms()] * 3 + [0.0] * 6 + [1.0] + [np.nan] * 6 + [15, 0]] * 3)
    page.send_raw(batch(page.next - 3, rows))
    time.sleep(0.1)
    headset.stop()
    assert len(headset.read().poses["headset/eye"]) == 5


# Connections.


def test_what_the_page_holds_while_the_recorder_is_away_is_not_lost(headset, page):
    headset.start("take")
    frames(page, 20)
    time.sleep(0.2)
    page.disconnect()
    frames(page, 50)
    page.connect()
    frames(page, 20)
    headset.stop()
    columns = headset.read()
    samples = columns.poses["headset/eye"]
    assert len(samples) == 90
    assert samples.good.all()
    states = [detail["state"] for detail in events_of(columns, "connection")]
    assert states == ["lost", "open"]
    assert set(samples.epoch.tolist()) == {0}


def test_a_page_that_comes_again_replaces_its_own_dead_connection(headset, page, wait_for):
    headset.start("take")
    again = FakePage(headset.url, page=page.page)
    again.next = page.next
    again.connect()
    wait_for(lambda: page.closed is not None)
    assert page.closed[0] == protocol.REPLACED
    again.begin_session()
    frames(again, 10)
    headset.stop()
    again.disconnect()
    columns = headset.read()
    assert len(columns.poses["headset/eye"]) == 10
    states = [detail["state"] for detail in events_of(columns, "connection")]
    assert states == ["lost", "open"]


def test_a_page_loaded_anew_has_a_new_world(headset, page, wait_for):
    headset.start("take")
    frames(page, 10)
    time.sleep(0.5)
    page.disconnect()
    with FakePage(headset.url) as fresh:
        wait_for(lambda: headset.server.hello.page == fresh.page)
        fresh.begin_session()
        fresh.frame(*STILL)
        wait_for(lambda: headset.link.synchronised)
        frames(fresh, 10)
        headset.stop()
    columns = headset.read()
    samples = columns.poses["headset/eye"]
    assert samples.epoch.tolist() == [0] * 10 + [1] * 11
    assert samples.good.tolist() == [True] * 10 + [False] + [True] * 10
    assert events_of(columns, "recentre") == [{"epoch": 1}]


def test_a_session_that_ends_in_a_take_is_recorded_as_that(headset, page, wait_for):
    headset.start("take")
    frames(page, 20)
    page.end_session()
    wait_for(lambda: headset.missing is not None)
    time.sleep(0.4)
    headset.stop()
    columns = headset.read()
    assert len(columns.poses["headset/eye"]) == 20
    assert columns.poses["headset/eye"].good.all()
    assert events_of(columns, "session-end") == [{}]
    (gap,) = events_of(columns, "gap")
    assert gap["kind"] == "end"
    assert gap["seconds"] > 0.3


def test_a_connection_that_never_comes_back_leaves_what_was_sure(headset, page):
    headset.start("take")
    frames(page, 100, every_s=0.01)
    time.sleep(0.2)
    page.disconnect()
    headset.stop()
    samples = headset.read().poses["headset/eye"]
    # what came after the last look at its clock can't be told its time
    assert len(samples) == 100
    assert samples.good[:40].all()
    assert np.all(np.diff(samples.good.astype(int)) <= 0)


@pytest.mark.parametrize("jump_ms", [-2000.0, -100.0, 500.0, 3_600_000.0])
def test_a_clock_that_jumps_is_told_and_no_pose_gets_a_wrong_time(headset, page, wait_for, jump_ms):
    headset.start("take")
    time.sleep(MARGIN_S)
    truth = []

    def go(seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            page.frame(*STILL)
            truth.append(headset._host.now())
            time.sleep(0.004)

    go(0.8)
    page.shift_ms += jump_ms
    go(1.4)
    time.sleep(MARGIN_S)
    headset.stop()
    columns = headset.read()
    samples = columns.poses["headset/eye"]
    assert len(samples) == len(truth)
    wrong = np.abs(samples.pose_t - np.array(truth)) > 30_000_000
    assert not np.any(wrong & samples.good)
    assert samples.good[:100].all()
    assert samples.good[-50:].all()
    assert not samples.good.all()
    assert [x for x in events_of(columns, "clock") if x["state"] == "lost"]
    # the whole recording goes into a take, whose good poses are a trajectory
    assert len(samples.trajectory()) == samples.good.sum()


def test_a_headset_that_sleeps_is_told(headset, page):
    headset.start("take")
    frames(page, 10)
    time.sleep(0.3)
    page.answers = False
    time.sleep(0.8)
    page.shift_ms -= 700.0  # its clock stood still meanwhile
    page.answers = True
    end = time.monotonic() + 1.5
    while time.monotonic() < end:
        page.frame(*STILL)
        time.sleep(0.01)
    headset.stop()
    columns = headset.read()
    samples = columns.poses["headset/eye"]
    assert [x for x in events_of(columns, "clock") if x["state"] == "lost"]
    (gap,) = [x for x in events_of(columns, "gap") if x["kind"] == "time"]
    assert gap["seconds"] > 0.5
    assert samples.good[-20:].all()
    delay = (samples.receive_t - samples.pose_t)[samples.good]
    assert np.all(np.abs(delay) < 600e6)


def test_a_headset_that_stays_silent_is_let_go(headset, page, wait_for, monkeypatch):
    monkeypatch.setattr("vrbench_webxr.server.SILENT_S", 0.5)
    headset.start("take")
    page.answers = False
    wait_for(lambda: page.closed is not None)
    assert page.closed == (protocol.REPLACED, "no answer for 0.5 s")
    headset.stop()
    what, fix = headset.missing
    assert what == "no headset is connected"
    assert headset.url in fix


# The route.


def test_a_take_needs_a_headset(serving):
    says = r"no headset is connected.*open http://localhost"
    with serving(wait_s=0.1) as headset, pytest.raises(DeviceError, match=says):
        headset.start("take")


def test_a_take_needs_a_session(serving, wait_for):
    with serving(wait_s=0.1) as headset, FakePage(headset.url):
        wait_for(lambda: headset.server.connected)
        with pytest.raises(DeviceError, match="press Start on the page"):
            headset.start("take")


def test_the_first_take_waits_for_somebody_to_press_start(headset):
    with FakePage(headset.url) as page:
        press = threading.Timer(0.4, lambda: (page.begin_session(), page.frame(*STILL)))
        press.start()
        headset.start("take")
        frames(page, 5)
        headset.stop()
    assert headset.read().poses["headset/eye"].good.sum() == 5


def test_a_port_in_use_is_named(headset, serving):
    port = headset.url.rsplit(":", 1)[1].split("/")[0]
    with pytest.raises(DeviceError, match=rf"can't listen at 127\.0\.0\.1:{port}"):
        serving(listen=f"127.0.0.1:{port}").__enter__()


def test_a_fixed_token_lets_a_session_outlive_the_recorder(serving, wait_for):
    with serving(token="samesecret") as first:
        port = first.url.rsplit(":", 1)[1].split("/")[0]
        page = FakePage(first.url)
        page.connect()
        page.begin_session()
        wait_for(lambda: first.link.synchronised)
    wait_for(lambda: page.closed is not None)
    page.disconnect()
    frames(page, 3)
    with serving(token="samesecret", listen=f"127.0.0.1:{port}") as second:
        page.connect()
        page.begin_session()
        page.frame(*STILL)
        wait_for(lambda: second.missing is None)
        second.start("take")
        frames(page, 10)
        second.stop()
        assert second.read().poses["headset/eye"].good.sum() == 10
        page.disconnect()


def test_takes_are_shown_on_the_page(headset, page, wait_for):
    headset.start("replay.default.m1.r2")
    headset.stop()
    wait_for(lambda: len(page.heard) >= 3)
    welcome, *said = page.heard
    assert welcome["type"] == "welcome"
    assert welcome["take"] is None
    assert said == [
        {"type": "take", "name": "replay.default.m1.r2"},
        {"type": "take", "name": None},
    ]


def test_the_recorder_writes_a_take_that_reads_back(headset, page, tmp_path):
    over = threading.Event()
    player = threading.Thread(target=play, args=(page, 120.0, lambda: not over.is_set()))
    player.start()

    def movement():
        for done in range(5):
            time.sleep(0.1)
            yield done / 5

    path = tmp_path / "replay.default.m1.r1.mcap"
    received = record_take(
        path, {}, {"headset": headset}, movement(), headset._host, lambda *_: None
    )
    over.set()
    player.join()
    columns = read_take(path)
    samples = columns.poses["headset/eye"]
    assert len(samples) == received["headset/eye"] > 100
    assert samples.good.all()
    assert len(columns.joints["headset/frames"]) == len(samples)
    assert len(columns.clocks["headset"]) > 10
    assert events_of(columns, "headset")[0]["agent"] == "vrbench emulator"
