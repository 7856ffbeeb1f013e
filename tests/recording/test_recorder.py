"""A recording meets trouble: what is noticed, what is told, and what a crash leaves."""

from __future__ import annotations

import struct
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader

from vrbench.devices.host import RealClock
from vrbench.errors import DataError
from vrbench.geometry import Transform
from vrbench.recording.monitor import Monitor
from vrbench.recording.recorder import record_take
from vrbench.recording.take import TakeWriter, read_take
from vrbench.streams import GOOD, Columns, Samples
from vrbench.trajectory import NS

START = 1_700_000_000 * NS


def samples(begin_s: float, end_s: float, rate_hz: float = 100.0, flags: int = GOOD) -> Samples:
    t = START + np.arange(round(begin_s * NS), round(end_s * NS), round(NS / rate_hz))
    n = len(t)
    pose = Transform(np.zeros((n, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)))
    return Samples.of(t, pose, flags=flags)


class Steady:
    """Sends poses in real time."""

    def __init__(self, host):
        self._host, self._read = host, 0

    def start(self, take):
        self._read = self._host.now()

    def read(self):
        now = self._host.now()
        t = np.arange(self._read, now, 10_000_000)
        self._read = now
        n = len(t)
        pose = Transform(np.zeros((n, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)))
        return Columns({"headset/eye": Samples.of(t, pose)} if n else {})

    def stop(self):
        pass


# -- what a crash leaves


def cut(tmp_path: Path, share: float) -> tuple[Path, Path]:
    """A take of twenty seconds, and what of it stood there when a part of it was written."""
    path = tmp_path / "a.mcap"
    with TakeWriter(path, {"case": "replay"}) as writer:
        for second in np.arange(0.0, 20.0, 0.1):
            writer.write(Columns({"headset/eye": samples(second, second + 0.1)}))
    part = tmp_path / "b.mcap.part"
    content = path.read_bytes()
    part.write_bytes(content[: round(share * len(content))])
    return path, part


@pytest.mark.parametrize("share", [0.2, 0.5, 0.77, 0.9])
def test_every_complete_chunk_of_a_cut_take_reads_back(tmp_path, share):
    path, part = cut(tmp_path, share)
    whole, kept = read_take(path).poses["headset/eye"], read_take(part).poses["headset/eye"]
    assert 0 < len(kept) < len(whole)
    np.testing.assert_array_equal(kept.pose_t, whole.pose_t[: len(kept)])
    assert read_take(part).metadata["case"] == "replay"
    count = 0
    with part.open("rb") as file:
        try:
            for _, channel, _ in NonSeekingReader(file).iter_messages(log_time_order=False):
                count += channel.topic == "/headset/eye/samples"
        except (EndOfFile, struct.error):
            pass  # the cut
    assert count == len(kept)


def test_a_cut_take_under_a_whole_one_s_name_is_refused(tmp_path):
    _, part = cut(tmp_path, 0.5)
    lying = part.with_name("c.mcap")
    part.rename(lying)
    with pytest.raises(DataError, match="is not a whole MCAP file"):
        read_take(lying)


def test_while_it_is_written_all_but_the_last_second_is_there(tmp_path):
    with TakeWriter(tmp_path / "a.mcap", {}) as writer:
        for second in np.arange(0.0, 7.0, 0.1):
            writer.write(Columns({"headset/eye": samples(second, second + 0.1)}))
            if second > 1.5:
                kept = read_take(tmp_path / "a.mcap.part").poses["headset/eye"]
                assert (START - kept.pose_t[-1]) / NS + second + 0.1 < 1.2


# -- the host's clock


def test_the_host_s_clock_is_read_beside_utc_and_its_steps_are_told(tmp_path, monkeypatch):
    host, real, stepped = RealClock(), time.time_ns, []
    monkeypatch.setattr(time, "time_ns", lambda: real() + (3 * NS if stepped else 0))

    def movement():
        for k in range(5):
            host.wait(0.6)
            if k == 2:
                stepped.append(True)
            yield k / 5

    told = []
    devices = {"headset": Steady(host)}
    path = tmp_path / "a.mcap"
    record_take(path, {}, devices, movement(), host, lambda _: None, notice=told.append)
    take = read_take(path)
    (event,) = [event for event in take.events if event.kind == "host-clock-step"]
    assert event.detail["seconds"] == pytest.approx(3.0, abs=0.1)
    assert len(told) == 1
    assert "the host's clock was stepped by +3." in told[0]
    readings = take.clocks["host"]
    ahead = (readings.remote_sent - (readings.sent + readings.received) // 2) / NS
    assert len(ahead) >= 4
    assert ahead[-1] - ahead[0] == pytest.approx(3.0, abs=0.1)
    # the stamps of poses know nothing of it
    assert np.diff(take.poses["headset/eye"].pose_t).max() < NS


# -- progress


def looked_at(*parts: Samples) -> Monitor:
    monitor = Monitor(START)
    for part in parts:
        monitor.add({"headset/eye": part}, int(part.pose_t[-1]))
    return monitor


def test_rates_are_of_the_last_moments():
    fast = [samples(s, s + 0.5, 100.0) for s in np.arange(0.0, 5.0, 0.5)]
    slow = [samples(s, s + 0.5, 40.0) for s in np.arange(5.0, 12.0, 0.5)]
    (state,) = looked_at(*fast).progress(0.5, START + 5 * NS).streams
    assert state.rate_hz == pytest.approx(100.0, rel=0.01)
    (state,) = looked_at(*fast, *slow).progress(0.5, START + 12 * NS).streams
    assert state.rate_hz == pytest.approx(40.0, rel=0.02)
    assert state.received == 500 + 280


def test_gaps_are_counted_within_and_between_looks():
    parts = [samples(0.0, 1.0), samples(1.2, 2.0), samples(2.0, 3.0)[np.r_[0:40, 60:100]]]
    (state,) = looked_at(*parts).progress(0.5, START + 3 * NS).streams
    assert state.gaps == 2


def test_tracking_and_silence_are_told():
    parts = [samples(0.0, 1.0), samples(1.0, 2.0, flags=0)]
    (state,) = looked_at(*parts).progress(0.5, START + 5 * NS).streams
    assert state.tracked == pytest.approx(0.5)
    assert state.silent_s == pytest.approx(3.0, abs=0.02)


def test_the_time_left_follows_from_the_part_done():
    monitor = Monitor(START)
    assert monitor.progress(0.0, START + 5 * NS).left_s is None
    assert monitor.progress(0.25, START + 10 * NS).left_s == pytest.approx(30.0)
