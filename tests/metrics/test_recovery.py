from dataclasses import replace

import numpy as np
import pytest

from vrbench.devices.simulated.noise import correlated
from vrbench.geometry import Transform
from vrbench.metrics import recovery
from vrbench.streams import Columns, Event, Samples
from vrbench.trajectory import NS


def lost(s):
    return (s < 8.0) | (s > 9.0)


def test_recovery_takes_the_loss_and_the_time_until_the_error_is_gone(values, make_take):
    def spoil(s, pose):
        off = ((s > 9) & (s < 11)) * 0.02
        return Transform(pose.p + np.outer(off, [1, 0, 0]), pose.q)

    found = values(recovery.FAMILY, make_take(keep=lost, spoil=spoil))
    assert found["recovery.time", "eye", "all", "max"].value == pytest.approx(3.0, abs=0.03)
    assert found["recovery.offset", "eye", "all", "max"].value == pytest.approx(20, abs=0.01)
    assert found["recovery.offset", "eye", "all", "max"].samples == 1


@pytest.mark.parametrize("name", ["BEFORE_S", "RECOVERED_M", "HELD_S"])
def test_the_time_does_not_hang_on_where_the_lines_were_drawn(values, make_take, monkeypatch, name):
    """A headset with ordinary noise is lost at 8 s, and jumps back into place at 11 s."""
    wander = correlated(np.random.default_rng(4), 0.0007, 2.0, 3)

    def spoil(s, pose):
        off = np.outer(((s > 9) & (s < 11)) * 0.03, [1, 0, 0])
        return Transform(pose.p + off + wander(s), pose.q)

    taken, usual = make_take(keep=lost, spoil=spoil), getattr(recovery, name)
    for factor in (0.5, 1.0, 2.0):
        monkeypatch.setattr(recovery, name, factor * usual)
        found = values(recovery.FAMILY, taken)["recovery.time", "eye", "all", "max"]
        assert found.value == pytest.approx(3.0, abs=0.03), factor


def test_an_offset_that_stays_never_recovers(values, make_take):
    def spoil(s, pose):
        return Transform(pose.p + np.outer((s > 8.5) * 0.02, [1, 0, 0]), pose.q)

    found = values(recovery.FAMILY, make_take(keep=lost, spoil=spoil))
    assert "1 of 1 losses never" in found["recovery.time", "eye", "all", "max"].reason
    assert found["recovery.offset", "eye", "all", "mean"].value == pytest.approx(20, abs=0.01)


def test_without_a_loss_there_is_nothing_to_recover_from(values, make_take):
    found = values(recovery.FAMILY, make_take())
    assert "never lost" in found["recovery.time", "eye", "all", "max"].reason


def covered_take(make_take, *, covered: float, uncovered: float, **more):
    """A take in which hands covered all cameras, and said so, at these seconds."""
    taken = make_take(**more)
    start = int(taken.reference.t[0])
    events = [
        Event(start + round(s * NS), "occlusion", {"level": level, "cameras": []})
        for s, level in ((covered, "all"), (uncovered, "none"))
    ]
    robot = Samples.of(taken.reference.t, taken.reference.pose)
    return replace(taken, columns=Columns({"robot/tcp": robot}, events=events))


def twice_lost(s):
    """By chance at 3 s, for a moment; while covered from 8 to 13 s, it sees a little at 10 s."""
    return ((s < 3.0) | (s > 3.3)) & ((s < 8.2) | ((s > 10.0) & (s < 10.2)) | (s > 13.0))


def late_by(seconds, s):
    """Off by 20 mm after it was covered, until so long after 13 s."""
    return np.outer(((s > 8.2) & (s < 13.0 + seconds)) * 0.02, [1, 0, 0])


@pytest.mark.parametrize(("said", "found", "right"), [(12.0, 1.0, 3.0), (13.5, 0.0, 1.5)])
def test_where_hands_covered_cameras_only_that_loss_counts_from_when_they_were_free(
    values, make_take, said, found, right
):
    """Somebody may say so late: what the headset found before took it no time."""

    def spoil(s, pose):
        return Transform(pose.p + late_by(2.0, s), pose.q)

    taken = covered_take(make_take, covered=8.0, uncovered=said, keep=twice_lost, spoil=spoil)
    got = values(recovery.FAMILY, taken)
    assert got["recovery.found", "eye", "all", "max"].samples == 1
    assert got["recovery.found", "eye", "all", "max"].value == pytest.approx(found, abs=0.03)
    assert got["recovery.time", "eye", "all", "max"].value == pytest.approx(right, abs=0.03)
    assert got["recovery.offset", "eye", "all", "max"].value == pytest.approx(20, abs=0.01)


def test_a_headset_that_goes_on_with_its_cameras_covered_has_nothing_to_recover_from(
    values, make_take
):
    taken = covered_take(make_take, covered=12.0, uncovered=15.0, keep=lost)
    found = values(recovery.FAMILY, taken)
    assert "while cameras were covered" in found["recovery.time", "eye", "all", "max"].reason


def test_a_covering_ends_where_hands_go_back_to_what_the_condition_covers():
    steps = [("two", [0, 3]), ("all", [0, 1, 2, 3]), ("two", [0, 3])]
    events = [Event(t, "occlusion", {"level": a, "cameras": b}) for t, (a, b) in enumerate(steps)]
    assert recovery.coverings(events) == [(1, 2)]
