"""The route and the relay on a made-up runtime, and on a real Monado where there is one."""

import os
import shutil
import subprocess
import sys
import threading
import time
import tomllib
from pathlib import Path

import numpy as np
import pluggy
import pytest
import vrbench_openxr
from vrbench_openxr.profiles import HEADSETS
from vrbench_openxr.relay import Relay, main
from vrbench_openxr.route import OpenXRHeadset, Options, check, samples_of
from vrbench_openxr.runtime import Located, Runtime, ticks_of
from vrbench_openxr.sampler import Sampler

from vrbench.devices.host import RealClock
from vrbench.devices.ports import Session
from vrbench.errors import ConfigError, DeviceError
from vrbench.geometry import Transform

HERE = Path(__file__).parents[1]
XR_AHEAD_NS = 123_456_789_012_345


def session():
    return Session(RealClock(), Transform.identity(), seed=0)


def wait_for(condition, seconds=10.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "what was waited for did not come"
        time.sleep(0.01)


def events_of(columns, kind):
    return [dict(event.detail) for event in columns.events if event.kind == kind]


def expected(path, samples):
    """The poses that the made-up head has at the times of samples."""
    times = (samples.source_t - XR_AHEAD_NS).tolist()
    return np.array([path(t) for t in times])


# The plugin.


def test_the_hook_gives_six_models_and_the_route():
    manager = pluggy.PluginManager("vrbench")
    manager.register(vrbench_openxr, "openxr")
    (headsets,) = manager.hook.vrbench_headsets()
    assert [x.name for x in headsets] == [
        "index", "vive", "varjo", "wmr", "psvr2", "monado", "openxr",
    ]  # fmt: skip
    project = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["entry-points"] == {"vrbench": {"openxr": vrbench_openxr.__name__}}


def test_listing_the_plugin_loads_no_sdk():
    code = (
        "import sys, vrbench_openxr; vrbench_openxr.vrbench_headsets();"
        "sys.exit('xr' in sys.modules or 'websockets' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("spec", HEADSETS, ids=lambda spec: spec.name)
def test_every_level_covers_cameras_that_the_headset_has(spec):
    for ids in spec.profile.occlusion.values():
        assert set(ids) <= set(spec.profile.cameras)
    assert spec.profile.occlusion["none"] == ()
    assert "made up" in spec.profile.tracking.source


# The route.


def record(headset, seconds=0.3):
    headset.start("take")
    time.sleep(seconds)
    headset.stop()
    return headset.read()


def test_poses_are_those_of_the_times_that_were_asked_for(fake, path):
    with OpenXRHeadset(Options(rate_hz=200), None, session()) as headset:
        columns = record(headset)
        assert headset.read().poses == {}
    samples = columns.poses["headset/eye"]
    assert len(samples) > 20
    assert samples.good.all()
    truth = expected(path, samples)
    np.testing.assert_allclose(samples.pose.p, truth[:, :3], atol=1e-6)
    np.testing.assert_allclose(samples.pose.q, truth[:, 3:], atol=1e-6)
    # asked for now, so it is now, on the recorder's clock
    assert 0 <= np.median(samples.receive_t - samples.pose_t) < 100e6
    assert np.all(np.diff(samples.pose_t) > 0)
    (facts,) = events_of(columns, "headset")
    assert facts["runtime"] == "Fake"
    assert facts["system"] == "Head"
    assert len(fake.thread) == 1
    assert fake.alive == set()
    assert fake.begun == 1


def test_a_pose_may_be_asked_for_ahead_of_now(fake):
    with OpenXRHeadset(Options(ahead_s=0.04), None, session()) as headset:
        samples = record(headset).poses["headset/eye"]
    assert np.median(samples.pose_t - samples.receive_t) > 30e6


def test_a_recentre_counts_from_the_time_that_the_runtime_tells(fake):
    with OpenXRHeadset(Options(rate_hz=200), None, session()) as headset:
        headset.start("take")
        time.sleep(0.1)
        change = time.perf_counter_ns() + XR_AHEAD_NS + 150_000_000
        fake.recentre(change)
        fake.recentre(change, kind="STAGE")  # of a space that isn't ours
        time.sleep(0.3)
        headset.stop()
        columns = headset.read()
    samples = columns.poses["headset/eye"]
    np.testing.assert_array_equal(samples.epoch, samples.source_t >= change)
    assert set(samples.epoch.tolist()) == {0, 1}
    assert events_of(columns, "reset") == [{"space": "local"}]
    assert events_of(columns, "recentre") == [{"epoch": 1}]


def test_a_recentre_without_notice_leaves_no_pose_in_the_old_epoch(fake):
    found = []

    def on_pose(located):
        if len(found) == 5:  # from the next pose on, in the new space
            fake.recentre(located.xr_time + 1)
        found.append(located.epoch)

    with Sampler(
        Runtime(), rate_hz=500, ahead_s=0.0, on_pose=on_pose, on_event=lambda kind, detail: None
    ):
        wait_for(lambda: len(found) >= 12)
    assert found[:12] == [0] * 6 + [1] * 6


@pytest.mark.parametrize("flags", [0, 5, 7, 10])
def test_poses_that_are_not_tracked_are_no_good_ones(fake, flags):
    fake.flags = flags
    with OpenXRHeadset(Options(), None, session()) as headset:
        samples = record(headset, 0.1).poses["headset/eye"]
    assert set(samples.flags.tolist()) == {flags}
    assert not samples.good.any()


def test_what_is_no_pose_is_never_a_good_one():
    poses = [
        (Located(0, 1, 1, (np.nan, 0, 0, 0, 0, 0, 1), 15, 0), 2),
        (Located(0, 2, 2, (0, 0, 0, 0, 0, 0, 0), 15, 0), 3),
        (Located(0, 3, 3, (0, 0, 0, 0, 0, 0, 1), 15, 0), 4),
    ]
    samples = samples_of(poses, 100)
    assert samples.flags.tolist() == [5, 10, 15]
    assert samples.pose_t.tolist() == [101, 102, 103]
    assert np.isfinite(samples.pose.p).all()


def test_a_session_that_ends_in_a_take_is_recorded_as_that(fake):
    with OpenXRHeadset(Options(), None, session()) as headset:
        headset.start("take")
        time.sleep(0.1)
        fake.state("STOPPING")
        time.sleep(0.3)
        after = RealClock().now()
        headset.stop()
        columns = headset.read()
        assert events_of(columns, "session-end") == [{"why": "stopping"}]
        assert fake.ended == 1
        assert columns.poses["headset/eye"].pose_t.max() < after
        with pytest.raises(DeviceError, match="the OpenXR session has ended"):
            headset.start("next")


def test_a_runtime_that_fails_in_a_take_is_recorded_as_that(fake):
    with OpenXRHeadset(Options(), None, session()) as headset:
        headset.start("take")
        time.sleep(0.1)
        fake.fails = fake.xr.exception.RuntimeFailureError("gone")
        time.sleep(0.2)
        headset.stop()
        columns = headset.read()
    (end,) = events_of(columns, "session-end")
    assert "gone" in end["why"]
    assert columns.poses["headset/eye"].good.all()


def test_a_runtime_without_headless_is_named(fake):
    fake.offered.remove("XR_MND_headless")
    with pytest.raises(DeviceError, match="lacks XR_MND_headless"):
        OpenXRHeadset(Options(), None, session()).__enter__()
    assert fake.alive == set()


def test_a_session_that_never_becomes_ready_is_given_up(fake, monkeypatch):
    monkeypatch.setattr("vrbench_openxr.runtime.READY_S", 0.05)
    fake.events.clear()
    with pytest.raises(DeviceError, match="doesn't become ready"):
        OpenXRHeadset(Options(), None, session()).__enter__()
    assert fake.alive == set()


def test_rig_check_tells_what_the_runtime_gives(fake):
    told = list(check(Options(rate_hz=50), session()))
    assert told[0].ok
    assert told[0].what.startswith("Head by Fake")
    assert told[-1].what == "100% of poses tracked"
    fake.flags = 3
    for state in ("READY",):
        fake.state(state)
    assert not list(check(Options(rate_hz=50), session()))[-1].ok
    fake.offered.clear()
    (only,) = check(Options(), session())
    assert not only.ok


def test_ticks_keep_every_digit():
    assert ticks_of(1_795_310_546_486_098_163, 10_000_000) == 17_953_105_464_860_981


def test_without_a_runtime_the_reason_is_given(monkeypatch, tmp_path):
    pytest.importorskip("xr", reason="pyopenxr is not here: pip install pyopenxr PyOpenGL")
    monkeypatch.setenv("XR_RUNTIME_JSON", str(tmp_path / "none.json"))
    monkeypatch.setenv("XR_LOADER_DEBUG", "none")
    with pytest.raises(DeviceError, match="no OpenXR session"), Runtime():
        pass


# The relay, with the recorder of vrbench-webxr.


@pytest.fixture
def recorder():
    route = pytest.importorskip("vrbench_webxr.route", reason="vrbench-webxr is not here")
    options = route.Options(listen="127.0.0.1:0", quiet=True)
    headset = route.WebXRHeadset(options, None, session())
    headset.serve()
    yield headset
    headset.__exit__(None, None, None)


@pytest.fixture
def relay(fake, recorder):
    """A relay to the recorder, running until the test ends."""
    said, over = [], threading.Event()
    made = Relay(recorder.url, None, said.append, 200.0)
    made.said = said
    sampler = Sampler(
        Runtime(), rate_hz=200, ahead_s=0.0, on_pose=made.on_pose, on_event=made.on_event
    )
    with sampler:
        thread = threading.Thread(target=made.run, args=(sampler, lambda: not over.is_set()))
        thread.start()
        wait_for(lambda: recorder.missing is None)
        yield made
        over.set()
        thread.join()


def test_the_relay_speaks_the_pages_protocol(fake, path, recorder, relay):
    columns = record(recorder, 0.5)
    samples = columns.poses["headset/eye"]
    assert len(samples) > 30
    assert samples.good.all()
    # its source time is the system's clock, on which both ends of this test run
    frames = columns.joints["headset/frames"]
    truth = np.array([path(round(ms * 1e6)) for ms in frames.position[:, 0]])
    np.testing.assert_allclose(samples.pose.p, truth[:, :3], atol=1e-6)
    np.testing.assert_allclose(samples.pose.q, truth[:, 3:], atol=1e-6)
    # a busy computer pauses, and loses nothing by that
    assert not [gap for gap in events_of(columns, "gap") if gap["kind"] == "sequence"]
    (facts,) = events_of(columns, "headset")
    assert facts["client"] == "openxr relay"
    assert facts["agent"].startswith("Head Fake")
    assert facts["space"] == "local"
    assert relay.said == ["connected", "take take", "take ends"]


def test_recentres_go_over_the_wire(fake, recorder, relay):
    recorder.start("take")
    time.sleep(0.2)
    fake.recentre(time.perf_counter_ns() + XR_AHEAD_NS)
    time.sleep(0.3)
    recorder.stop()
    columns = recorder.read()
    assert set(columns.poses["headset/eye"].epoch.tolist()) == {0, 1}
    assert events_of(columns, "reset") == [{"space": "local"}]


def test_a_break_of_the_connection_loses_no_pose(fake, recorder, relay, monkeypatch):
    monkeypatch.setattr("vrbench_openxr.relay.RETRY_S", 0.1)
    recorder.start("take")
    time.sleep(0.2)
    loop, connection = recorder.server._loop, recorder.server._connection
    loop.call_soon_threadsafe(connection.transport.abort)
    wait_for(lambda: relay.said.count("connected") == 2)
    time.sleep(0.3)
    recorder.stop()
    columns = recorder.read()
    samples = columns.poses["headset/eye"]
    assert samples.good.all()
    assert not [x for x in events_of(columns, "gap") if x["kind"] == "sequence"]


def test_a_recorder_that_falls_silent_is_left_and_found_again(fake, monkeypatch):
    from websockets.sync.server import serve

    monkeypatch.setattr("vrbench_openxr.relay.SILENT_S", 0.3)
    monkeypatch.setattr("vrbench_openxr.relay.RETRY_S", 0.05)
    said, over = [], threading.Event()
    with serve(lambda socket: over.wait(20), "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.socket.getsockname()[1]}/token/"
        made = Relay(url, None, said.append, 200.0)
        with Sampler(
            Runtime(), rate_hz=50, ahead_s=0.0, on_pose=made.on_pose, on_event=made.on_event
        ) as sampler:
            thread = threading.Thread(target=made.run, args=(sampler, lambda: not over.is_set()))
            thread.start()
            wait_for(lambda: said.count("connected") == 2)
            over.set()
            thread.join()
        server.shutdown()
    assert said[:3] == ["connected", "the recorder is silent", "connected"]


def test_what_is_held_when_the_session_ends_waits_for_the_recorder(
    fake, recorder, relay, monkeypatch
):
    monkeypatch.setattr("vrbench_openxr.relay.RETRY_S", 0.3)
    recorder.start("take")
    time.sleep(0.2)
    loop, connection = recorder.server._loop, recorder.server._connection
    loop.call_soon_threadsafe(connection.transport.abort)
    wait_for(lambda: not recorder.server.connected)
    fake.state("STOPPING")
    wait_for(lambda: relay.said.count("connected") == 2)
    wait_for(lambda: not relay._holds())
    recorder.stop()
    columns = recorder.read()
    assert events_of(columns, "session-end") == [{"why": "stopping"}]
    assert columns.poses["headset/eye"].good.all()


def test_what_is_held_for_too_long_is_given_up_and_counted(fake, recorder, monkeypatch):
    monkeypatch.setattr("vrbench_openxr.relay.HELD", 50)
    made = Relay(recorder.url, None, lambda text: None, 200.0)
    for k in range(80):
        made.on_pose(Located(k, k, k, (0, 0, 0, 0, 0, 0, 1), 15, 0))
    batches, _ = made._unsent()
    assert len(batches) == 1
    assert np.frombuffer(batches[0], "<f8")[:3].tolist() == [1, 30, 50]
    assert made._dropped == 30


def test_a_recorder_that_refuses_ends_the_relay_with_its_reason(fake, recorder, capsys):
    with pytest.raises(SystemExit) as ended:
        main([recorder.url.replace(recorder.url.rsplit("/", 2)[1], "wrongtoken")])
    assert ended.value.code == 1
    assert "the recorder refuses" in capsys.readouterr().err


@pytest.mark.parametrize("url", ["localhost:8765", "ftp://localhost/"])
def test_an_address_that_is_none_is_refused(url):
    with pytest.raises(ConfigError, match="no address of a recorder"):
        Relay(url, None, print, 1.0)


# A real runtime.

MONADO = shutil.which("monado-service")
needs_monado = pytest.mark.skipif(
    MONADO is None,
    reason="no Monado is here: apt-get install monado-service libopenxr1-monado"
    " mesa-vulkan-drivers (Debian 13)",
)


@needs_monado
def test_a_real_monado_gives_the_simulated_head(monkeypatch, tmp_path):
    environment = {
        "XRT_COMPOSITOR_NULL": "1",
        "SIMULATED_ENABLE": "1",
        "XDG_RUNTIME_DIR": str(tmp_path),
        "XR_RUNTIME_JSON": "/usr/share/openxr/1/openxr_monado.json",
    }
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    # the service takes its orders from its input, so that has to stay open
    service = subprocess.Popen([MONADO], env=dict(os.environ), stdin=subprocess.PIPE)
    try:
        wait_for(lambda: list(tmp_path.glob("monado_comp_ipc*")), 20.0)
        with OpenXRHeadset(Options(rate_hz=200), None, session()) as headset:
            samples = record(headset, 1.0).poses["headset/eye"]
    finally:
        service.terminate()
        service.wait(10)
    assert len(samples) > 50
    # Monado says of its simulated head that its position isn't tracked
    assert set(samples.flags.tolist()) == {7}
    assert np.all(np.diff(samples.source_t) > 0)
    # two clocks of one system: their difference is one number
    assert np.ptp(samples.pose_t - samples.source_t) < 1_000_000


@needs_monado
def test_a_real_monado_locates_the_head_where_it_was_put(tmp_path):
    alone = ["unshare", "-n" if os.geteuid() == 0 else "-rn"]
    if subprocess.run([*alone, "true"], capture_output=True, check=False).returncode:
        pytest.skip(f"no network of its own can be made here: `{' '.join(alone)} true` fails")
    done = subprocess.run(
        [*alone, sys.executable, str(HERE / "tests" / "monado.py"), str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    told = [line for line in done.stdout.splitlines() if line.startswith("worst ")]
    assert told, done.stderr[-2000:]
    _, worst, _, flags, _, poses = told[0].split()
    assert float(worst) < 1e-6
    assert flags == "[15]"
    assert int(poses) == 30
