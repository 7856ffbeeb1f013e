"""Frames into takes, told by hand: no network, no threads, no waiting."""

import numpy as np
import pytest

from vrbench.devices.frames import COLUMNS, Frames
from vrbench.devices.link import FUTURE_NS, Link
from vrbench.trajectory import NS

MS = 1_000_000
ORIGIN = 1_700_000_000 * NS
START = 1_800_000_000 * NS


class Headset:
    """A headset whose clock runs with ours, `ahead_ms` after it; nothing takes time on the way."""

    def __init__(self, ahead_ms=5000.0):
        self.link, self.t, self.ahead_ms = Link(), START, ahead_ms
        self.number = 0
        self.link.on_hello("run", ORIGIN, {"model": "one"}, self.t)

    def now_ms(self):
        return (self.t - START) / MS + self.ahead_ms

    def answer(self):
        now = self.now_ms()
        self.link.on_answer(self.t - MS, now - 0.5, now - 0.5, self.t)

    def frame(self, *, callback_ms=None, display_ms=np.nan, flags=15, epoch=0):
        now = self.now_ms()
        row = np.full((1, len(COLUMNS)), np.nan)
        row[0, :3] = now if callback_ms is None else callback_ms, display_ms, now
        row[0, 3:10] = self.number, 0, 0, 0, 0, 0, 1
        row[0, 16:] = flags, epoch
        self.link.on_frames(self.number, row, self.t)
        self.number += 1

    def play(self, seconds, **frame):
        for _ in range(round(seconds * 100)):
            self.t += 10 * MS
            self.frame(**frame)
            if self.t // (100 * MS) != (self.t - 10 * MS) // (100 * MS):
                self.answer()

    def record(self, *parts):
        self.play(1.0)
        self.t += MS
        self.link.begin(self.t, {})
        for part in parts:
            part()
        self.answer()
        self.link.end(self.t)
        self.t += 100 * MS
        self.answer()
        self.link.finish(self.t)
        return self.link.take()


@pytest.fixture
def headset():
    return Headset()


def of(columns, kind):
    return [event.detail for event in columns.events if event.kind == kind]


def test_frames_get_the_recorders_time_and_none_is_lost(headset):
    columns = headset.record(lambda: headset.play(2.0))
    samples = columns.poses["headset/eye"]
    assert samples.good.all()
    assert np.diff(samples.pose.p[:, 0]).tolist() == [1.0] * (len(samples) - 1)
    assert abs(len(samples) - 200) <= 1
    np.testing.assert_allclose(samples.pose_t, samples.receive_t, atol=MS)
    assert headset.link.take().poses == {}


@pytest.mark.parametrize("step_ms", [-30_000, -5, 5, 30_000])
def test_across_a_step_of_the_clock_no_good_pose_has_a_wrong_time(headset, step_ms):
    def step():
        headset.ahead_ms += step_ms

    columns = headset.record(lambda: headset.play(1.0), step, lambda: headset.play(2.0))
    samples = columns.poses["headset/eye"]
    good = samples[samples.good]
    np.testing.assert_allclose(good.pose_t, good.receive_t, atol=2 * MS)
    assert not samples.good.all()
    assert samples.good[-50:].all()
    assert {"state": "lost"}.items() <= of(columns, "clock")[-1].items()


def test_a_pose_is_for_its_display_time_unless_that_is_of_another_clock(headset):
    def frames():
        headset.t += 10 * MS
        now = headset.now_ms()
        headset.frame(callback_ms=now - 3, display_ms=now + 30)
        headset.frame(callback_ms=now - 3)
        headset.frame(callback_ms=now - 3, display_ms=1.0e9)
        headset.frame(callback_ms=-1.0e9)

    samples = headset.record(frames).poses["headset/eye"]
    lead = (samples.pose_t - samples.receive_t) / MS
    np.testing.assert_allclose(lead, [30, -3, -3, 0], atol=0.6)
    assert samples.good.all()


def test_frames_from_the_future_are_no_good_ones(headset):
    def ahead():
        headset.t += 10 * MS
        now, row = headset.now_ms(), np.full((1, len(COLUMNS)), np.nan)
        row[0, [0, 2]] = now + 2 * FUTURE_NS / MS
        row[0, 3:10] = 0, 0, 0, 0, 0, 0, 1
        row[0, 16:] = 15, 0
        headset.link.on_frames(headset.number, row, headset.t)
        headset.t += 100 * MS

    samples = headset.record(ahead).poses["headset/eye"]
    assert samples.flags.tolist() == [0]


def test_sleep_loss_and_recentre_are_told(headset):
    def sleep():
        headset.t += 2 * NS

    def lose():
        headset.number += 7

    columns = headset.record(
        lambda: headset.play(0.5),
        sleep,
        lambda: headset.play(0.5),
        lose,
        lambda: headset.play(0.5, epoch=3),
    )
    gaps = of(columns, "gap")
    assert {"kind": "time", "seconds": pytest.approx(2.01, abs=0.02)} in gaps
    assert [gap["missing"] for gap in gaps if gap["kind"] == "sequence"] == [7]
    assert of(columns, "recentre") == [{"epoch": 1}]
    assert set(columns.poses["headset/eye"].epoch.tolist()) == {0, 1}


def test_frames_that_never_get_a_time_are_kept_as_no_good_ones():
    headset = Headset()
    headset.link.begin(headset.t, {})
    for _ in range(5):
        headset.t += 10 * MS
        headset.frame()
    headset.link.end(headset.t)
    headset.link.finish(headset.t)
    columns = headset.link.take()
    assert columns.poses["headset/eye"].flags.tolist() == [0] * 5
    assert of(columns, "clock")[0]["frames"] == 5


def test_an_app_started_anew_is_a_new_world(headset):
    def anew():
        headset.link.on_closed(headset.t, "closed")
        headset.link.on_hello("another", ORIGIN, {"state": "a fact"}, headset.t)
        headset.number = 0

    columns = headset.record(lambda: headset.play(0.5), anew, lambda: headset.play(2.0))
    samples = columns.poses["headset/eye"]
    assert set(samples.epoch.tolist()) == {0, 1}
    assert [x["state"] for x in of(columns, "connection")] == ["lost", "open"]


def test_times_that_are_none_are_taken_as_none():
    rows = np.full((2, len(COLUMNS)), np.nan)
    rows[:, 0], rows[:, 1], rows[:, 2] = 10.0, [np.inf, 12.0], 11.0
    frames = Frames(rows, np.zeros(2, np.int64), 0, 0)
    assert frames.refers.tolist() == [10 * MS, 12 * MS]


@pytest.mark.parametrize("step_ms", [-2, 1, 2])
def test_a_step_too_small_to_be_told_is_bounded_by_the_round_trip(headset, step_ms):
    def step():
        headset.ahead_ms += step_ms

    columns = headset.record(step, lambda: headset.play(15.0))
    samples = columns.poses["headset/eye"]
    assert samples.good.all()
    wrong = np.abs(samples.pose_t - samples.receive_t) / MS
    assert wrong.max() < abs(step_ms) + 0.1
    # half of the round trip of 1 ms, once the bounds of before are forgotten
    assert wrong[-100:].max() < 0.55
