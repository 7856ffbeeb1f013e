"""A person's capture on a live rig: an emulated Motive, and a headset that streams in real time."""

import time

import numpy as np
import pytest
from vrbench_optitrack.client import OPTITRACK
from vrbench_optitrack.scene import Scene

from vrbench.config.rig import Rig
from vrbench.config.suite import load_suite
from vrbench.devices.specs import HeadsetProfile, HeadsetSpec
from vrbench.plugin.manager import Plugins
from vrbench.runner import record_suite
from vrbench.streams import Columns, Samples

SCENE = Scene(motion="saturate-30s-1", begin_s=10.0)


class Headset:
    """Looks on from the body itself, in real time."""

    def __init__(self, options, profile, session):
        self._host, self._read = session.host, session.host.now()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def start(self, take):
        self._read = self._host.now()

    def read(self):
        now = self._host.now()
        t = np.arange(self._read, now, 10**9 // 72)
        self._read = now
        return Columns({"headset/eye": Samples.of(t, SCENE.head(t / 1e9 % 10))} if len(t) else {})

    def stop(self):
        pass


class Hasty:
    def ready(self, step):
        pass

    def perform(self, step, session):
        for _ in range(3):
            time.sleep(0.1)
            yield 0.5

    def take(self, name, index, total):
        pass

    def moving(self, progress):
        self.received = {stream.stream: stream.received for stream in progress.streams}

    def notice(self, text):
        pass


def test_a_capture_on_a_live_rig(motive, tmp_path, monkeypatch):
    server = motive()
    plugins = Plugins()
    headset = HeadsetSpec(name="live", title="", profile=HeadsetProfile(rate_hz=72.0), open=Headset)
    monkeypatch.setattr(plugins, "headsets", {"live": headset}, raising=False)
    monkeypatch.setattr(plugins, "mocap", {"optitrack": OPTITRACK}, raising=False)
    options = {"server": "127.0.0.1", "command_port": server.port, "body": "headset"}
    rig = Rig.model_validate(
        {
            "lab": "example",
            "headset": {"plugin": "live"},
            "mocap": {"plugin": "optitrack", "options": options},
        }
    )
    person = Hasty()
    bundle = record_suite(
        load_suite("head-capture"),
        rig,
        "lab.yaml",
        tmp_path / "run",
        plugins,
        person=person,
        seed=1,
        watcher=person,
        licence="CC-BY-4.0",
        consent="written",
    )
    assert (bundle.record.kind, bundle.record.seed) == ("recorded", None)
    columns = bundle.columns(bundle.record.takes[0])
    mocap = columns.poses["mocap/headset"]
    assert mocap.good.all()
    assert len(mocap) > 100
    assert len(columns.clocks["optitrack"]) > 3
    kinds = {event.kind for event in columns.events}
    assert {"server", "body", "pose-time", "phase"} <= kinds
    # stamps are the recorder's, as the headset's are; on a busy computer one begins later
    begin = columns.poses["headset/eye"].pose_t[0]
    assert mocap.pose_t[0] == pytest.approx(begin, abs=1e9)
