"""The source on a QTM made here: its RT protocol, as far as a client of 6DOF bodies needs it."""

import asyncio
import struct
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
from vrbench_qualisys import live
from vrbench_qualisys.live import QUALISYS, OneWayClock, Options, Qualisys

from vrbench.devices.ports import Session
from vrbench.errors import DeviceError
from vrbench.geometry import Axes, Transform, quat_to_matrix, relative_angle, rotvec_to_quat
from vrbench.plugin.testing import MocapConformance
from vrbench.streams import Samples

ERROR, COMMAND, XML, DATA = 0, 1, 2, 3
BODIES = ("controller", "headset")
PERIOD_S = 0.01
SKEW = 1.0 + 50e-6
DELAY_S = 0.004


def head(s):
    """`T_mocap_headset` at QTM's times (n,) [s], z up."""
    p = np.stack((0.3 * np.sin(2 * s), 0.2 * np.cos(s), 1.2 + 0.1 * np.sin(3 * s)), axis=-1)
    r = np.stack((0.4 * np.sin(s), 0.3 * np.sin(2 * s), 0.5 * np.cos(s)), axis=-1)
    return Transform(p, rotvec_to_quat(r))


def packet(kind, payload):
    return struct.pack("<II", 8 + len(payload), kind) + payload


def frame(index, lost, pose_at=head):
    stamp = index * PERIOD_S
    pose = pose_at(np.array([stamp]))
    body = b""
    for name in BODIES:
        if name == "headset" and lost:
            body += struct.pack("<13f", *[float("nan")] * 12, -1.0)
            continue
        here = pose if name == "headset" else Transform.of([[0, 0, 0]], [[0, 0, 0, 1]])
        turn = quat_to_matrix(here.q)[0].T.ravel()
        body += struct.pack("<13f", *(here.p[0] * 1e3), *turn, 0.4)
    component = struct.pack("<ihh", len(BODIES), 0, 0) + body
    component = struct.pack("<II", 8 + len(component), 11) + component
    return packet(DATA, struct.pack("<qII", round(stamp * 1e6), index, 1) + component)


class Qtm:
    """A server in a thread; `mute` sends no frames, `lose` gives the frames in which it is lost."""

    def __init__(self, *, mute=False, lose=lambda index: False, head=head):
        self.mute, self.lose, self.head = mute, lose, head
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        self._ready.wait(5)

    def _run(self):
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._serve())

    async def _serve(self):
        self._end = asyncio.Event()
        server = await asyncio.start_server(self._client, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        self._clients = set()
        self._ready.set()
        await self._end.wait()
        server.close()
        for task in list(self._clients):
            task.cancel()
        await asyncio.gather(*self._clients, return_exceptions=True)

    async def _client(self, reader, writer):
        self._clients.add(asyncio.current_task())
        streaming = None
        try:
            writer.write(packet(COMMAND, b"QTM RT Interface connected\0"))
            while True:
                size, kind = struct.unpack("<II", await reader.readexactly(8))
                words = (await reader.readexactly(size - 8)).rstrip(b"\0").decode().lower().split()
                assert kind == COMMAND
                if words[0] == "version":
                    writer.write(packet(COMMAND, b"Version set to 1.25\0"))
                elif words[0] == "getparameters":
                    names = "".join(f"<Body><Name>{name}</Name></Body>" for name in BODIES)
                    xml = f"<QTM_Parameters><The_6D>{names}</The_6D></QTM_Parameters>"
                    writer.write(packet(XML, xml.encode() + b"\0"))
                elif words == ["streamframes", "stop"]:
                    streaming.cancel()
                elif words[0] == "streamframes":
                    assert words[2:] == ["6dres"]
                    streaming = asyncio.create_task(self._stream(writer))
                    self._clients.add(streaming)
                else:
                    writer.write(packet(ERROR, b"Parse error\0"))
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        finally:
            if streaming is not None:
                streaming.cancel()
            writer.close()

    async def _stream(self, writer):
        if self.mute:
            writer.write(packet(4, b""))
            return
        self.first_ns = time.monotonic_ns()
        index = 0
        while True:
            due = self.first_ns / 1e9 + index * PERIOD_S / SKEW + DELAY_S
            await asyncio.sleep(max(0.0, due - time.monotonic()))
            writer.write(frame(index, self.lose(index), self.head))
            index += 1

    def close(self):
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(10)
        self._loop.close()


class TestConformance(MocapConformance):
    """What every plugin of motion capture passes."""

    name = "qualisys"
    rate_hz = 1 / PERIOD_S

    @classmethod
    @contextmanager
    def stand_in(cls, rehearsal):
        """The made-up QTM, z up, with a body that moves as it is rehearsed."""

        def when(stamp):
            return np.rint(qtm.first_rehearsed + stamp / SKEW * 1e9).astype(np.int64)

        def head(stamps):
            if qtm.first_rehearsed is None:
                qtm.first_rehearsed = rehearsal.now()
            return Axes("z", "y").from_openxr(rehearsal.pose(when(stamps)))

        def lost(index):
            if qtm.first_rehearsed is None:
                return False
            return not rehearsal.tracked(when(np.array([index * PERIOD_S])))[0]

        qtm = Qtm(head=head, lose=lost)
        qtm.first_rehearsed = None
        try:
            yield {"server": "127.0.0.1", "port": qtm.port, "body": "headset"}
        finally:
            qtm.close()


@pytest.fixture
def qtm():
    running = []

    def start(**options):
        running.append(Qtm(**options))
        return running[-1]

    yield start
    for server in running:
        server.close()


class MonotonicClock:
    def now(self):
        return time.monotonic_ns()

    def wait(self, seconds):
        time.sleep(seconds)


@pytest.fixture
def session():
    return Session(MonotonicClock(), Transform.identity(), 1)


def options(server, **more):
    return Options(**{"server": "127.0.0.1", "port": server.port, "body": "headset", **more})


def record(source, seconds=0.5):
    source.start("take")
    parts = []
    for _ in range(4):
        time.sleep(seconds / 4)
        parts.append(source.read())
    source.stop()
    parts.append(source.read())
    return Samples.concatenate([p.poses["mocap/headset"] for p in parts if p.poses]), parts


def test_poses_are_the_heads_and_their_times_late_by_the_least_delay(qtm, session):
    server = qtm()
    with Qualisys(options(server, up="y"), session) as source:
        samples, parts = record(source, 1.0)
    assert samples.good.all()
    assert len(samples) > 30
    truth = head(samples.source_t / 1e9)
    np.testing.assert_allclose(samples.pose.p, truth.p, atol=1e-6)
    assert relative_angle(samples.pose.q, truth.q).max() < 1e-3
    taken = server.first_ns + samples.source_t / SKEW
    late_ms = (samples.pose_t - taken) / 1e6
    assert late_ms.min() > 3.0
    assert np.ptp(late_ms) < 2.0
    (told,) = [e for part in parts for e in part.events if e.kind == "pose-time"]
    assert told.detail["from"].startswith("timestamp, least delay")


def test_z_up_is_turned_by_default(qtm, session):
    with Qualisys(options(qtm()), session) as source:
        samples, _ = record(source)
    truth = head(samples.source_t / 1e9)
    np.testing.assert_allclose(samples.pose.p, truth.p[:, [0, 2, 1]] * [1, 1, -1], atol=1e-6)
    # a point of the body, turned with it, lies where the room's turned point lies
    here = Transform(samples.pose.p, samples.pose.q).apply(np.array([0.1, 0.3, -0.2]))
    there = truth.apply(np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(here, there[:, [0, 2, 1]] * [1, 1, -1], atol=1e-6)


def test_a_lost_body_is_invalid(qtm, session):
    with Qualisys(options(qtm(lose=lambda i: i % 10 < 4)), session) as source:
        samples, _ = record(source, 1.0)
    assert 0.4 < samples.good.mean() < 0.8
    assert np.isfinite(samples.pose.p).all()


@pytest.fixture
def impatient(monkeypatch):
    for name, seconds in (("ANSWER_S", 0.5), ("FRAMES_S", 0.5)):
        monkeypatch.setattr(live, name, seconds)


@pytest.mark.usefixtures("impatient")
def test_what_is_wrong_is_told(qtm, session):
    def wrong(chosen):
        return [f for f in QUALISYS.check(chosen, session) if not f.ok]

    (finding,) = wrong(options(qtm(), body="hmd"))
    assert finding.what == "QTM has no rigid body 'hmd'"
    assert finding.fix == "there are 'controller', 'headset'"
    (finding,) = wrong(options(qtm(mute=True)))
    assert "sends no frames" in finding.what
    (finding,) = wrong(options(qtm(lose=lambda i: True)))
    assert "tracked in 0 % of frames" in finding.what
    assert wrong(options(qtm())) == []
    gone = qtm()
    chosen = options(gone)
    gone.close()
    gone.close = lambda: None
    (finding,) = wrong(chosen)
    assert "no answer from 127.0.0.1" in finding.what
    with pytest.raises(DeviceError, match="no answer from"):
        Qualisys(chosen, session).__enter__()


def test_a_connection_that_is_closed_is_an_error_and_not_a_hang(qtm, session):
    server = qtm()
    with Qualisys(options(server), session) as source:
        source.start("take")
        time.sleep(0.2)
        assert len(source.read().poses["mocap/headset"])
        server.close()
        server.close = lambda: None
        with pytest.raises(DeviceError, match="closed the connection"):
            for _ in range(30):
                time.sleep(0.1)
                source.read()


def test_the_least_delay_counts():
    clock = OneWayClock()
    rng = np.random.default_rng(1)
    stamps = np.arange(0, 5 * 10**9, 10**7)
    for stamp in stamps.tolist():
        clock.add(stamp, stamp + 77 * 10**9 + 3_000_000 + round(rng.exponential(2e6)))
    there = clock.to_host(stamps) - stamps
    assert np.all(np.abs(there - 77 * 10**9 - 3_000_000) < 50_000)
