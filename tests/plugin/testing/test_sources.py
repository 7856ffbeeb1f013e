"""What a bad device does is told, each fault by its own check."""

import contextlib
import re
import threading
from dataclasses import replace

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict, Field

from vrbench.devices.rehearsal import Rehearsal
from vrbench.devices.specs import HeadsetProfile, HeadsetSpec
from vrbench.geometry import UNITY, Axes, Transform
from vrbench.plugin.testing import HeadsetConformance, MocapConformance, opening, patience
from vrbench.plugin.testing.offered import check_options
from vrbench.plugin.testing.opening import Recorded
from vrbench.plugin.testing.verdicts import NonconformityError, NotCheckedError
from vrbench.streams import GOOD, Columns, Samples

BEGAN, RATE = 1_700_000_000 * 10**9, 72.0
OFFSET = 40_000_000_000_000  # of a device's clock that nobody follows [ns]


class Options(BaseModel):
    model_config = ConfigDict(extra="forbid")
    host: str = Field("here", description="address")


SPEC = HeadsetSpec("pico4", "Pico 4", HeadsetProfile(RATE, {0: "front"}), Options, open=print)


def rehearsed(*, recentres=True, followed=False, seconds=3.3):
    """What a device sends that does all as it should."""
    rehearsal = Rehearsal(lambda: 0, BEGAN, RATE, recentres)
    t = BEGAN + np.arange(round(RATE * seconds)) * round(1e9 / RATE) + 700_000_000
    own = t if followed else t + OFFSET
    samples = Samples(
        source_t=own,
        pose_t=own,
        receive_t=t + 3_000_000,
        pose=rehearsal.pose(t),
        flags=np.where(rehearsal.tracked(t), GOOD, 0).astype(np.uint32),
        epoch=rehearsal.epoch(t).astype(np.uint32),
    )
    ended = BEGAN + 700_000_000 + round(seconds * 1e9)
    return Recorded(
        rehearsal, "headset/eye", samples, [Columns({})], {}, None, ended, seconds, read_s=0.0
    )


def checked(samples_of=lambda x: x, **more):
    """Outcomes of every check of live poses, by name, of samples that were spoilt so."""
    recorded = rehearsed()
    recorded = replace(recorded, samples=samples_of(recorded.samples), **more)

    class Spoilt(HeadsetConformance):
        name = "pico4"

        @classmethod
        def recorded(cls):
            return recorded

        @classmethod
        def thing(cls):
            return SPEC

        def test_opening_without_a_device_fails_cleanly(self):
            pass

        def test_registering_imports_no_vendor_sdk(self):
            pass

        def test_its_plugin_is_whole(self):
            pass

    return {outcome.check: outcome for outcome in Spoilt.run()}


def failed(outcomes):
    return {name for name, outcome in outcomes.items() if outcome.status == "failed"}


def spoil(**fields):
    return lambda samples: replace(
        samples, **{name: make(samples) for name, make in fields.items()}
    )


def by(axes):
    return lambda samples: axes.from_openxr(samples.pose)


def test_a_sound_device_passes_every_check():
    outcomes = checked()
    assert {outcome.status for outcome in outcomes.values()} == {"passed"}
    assert len(outcomes) > 10


TWISTED = {
    "unity's axes": (by(UNITY), "left-handed with y up and z forward"),
    "z up": (by(Axes("z", "y")), "right-handed with z up and y forward"),
    "millimetres": (by(Axes("y", "-z", unit_m=0.001)), "positions are as they should be, in mm"),
    "metres for decimetres": (by(Axes("y", "-z", unit_m=10.0)), "be, 10 times too small"),
    "mirrored positions, rotations as they are": (
        lambda s: Transform(s.pose.p * [1, 1, -1], s.pose.q),
        "positions are left-handed .*rotations are as they should be",
    ),
    "w first": (
        lambda s: Transform(s.pose.p, s.pose.q[:, [3, 0, 1, 2]]),
        "positions are as they should be; rotations are .*in the order w x y z",
    ),
    "inverse rotations": (
        lambda s: Transform(s.pose.p, s.pose.q * [-1, -1, -1, 1]),
        "rotations are .*inverse",
    ),
}


@pytest.mark.parametrize("how", TWISTED)
def test_a_known_twist_names_what_is_wrong_with(how):
    pose, says = TWISTED[how]
    outcomes = checked(spoil(pose=pose))
    assert "known_twist" in failed(outcomes)
    outcome = outcomes["known_twist"]
    assert re.search(says, outcome.what), outcome.what
    assert "to_openxr" in outcome.fix


def swapped(samples):
    order = np.arange(len(samples))
    order[[50, 51]] = order[[51, 50]]
    return samples[order]


FAULTS = {
    "stamps that go back": (swapped, {"stamps_never_go_back"}, "go back at 1 of"),
    "quaternions of length 2": (
        spoil(pose=lambda s: Transform(s.pose.p, 2.0 * s.pose.q)),
        {"quaternions_are_of_unit_length"},
        "off unit length by 1",
    ),
    "half the poses left out": (lambda s: s[::2], {"rate_is_as_declared"}, "36.0 poses a second"),
    "a third of the poses left out, in holes": (
        lambda s: s[np.arange(len(s)) % 12 < 8],
        {"rate_is_as_declared"},
        "some are dropped",
    ),
    "loss that isn't told": (
        spoil(flags=lambda s: np.full(len(s), GOOD, dtype=np.uint32)),
        {"loss_is_told"},
        "count as good while tracking was lost",
    ),
    "no pose good": (
        spoil(flags=lambda s: np.zeros(len(s), dtype=np.uint32)),
        {"known_twist"},
        "most lack the flags orientation valid, position valid",
    ),
    "quaternions that `believed` took for none": (
        spoil(flags=lambda s: s.flags & ~np.uint32(1 | 4)),
        {"known_twist"},
        "most lack the flags orientation valid, orientation tracked",
    ),
    "microseconds for nanoseconds": (
        spoil(source_t=lambda s: s.source_t // 1000, pose_t=lambda s: s.pose_t // 1000),
        {"stamps_are_times"},
        "microseconds were taken for nanoseconds",
    ),
    "arrivals of no clock": (
        spoil(receive_t=lambda s: np.zeros(len(s), dtype=np.int64)),
        {"stamps_are_times"},
        "session.host.now()",
    ),
    "one epoch for all": (
        spoil(epoch=lambda s: np.zeros(len(s), dtype=np.uint32)),
        {"recentre_begins_an_epoch"},
        "worlds were shown, and epochs",
    ),
    "an epoch a second": (
        spoil(epoch=lambda s: (np.arange(len(s)) // 72).astype(np.uint32)),
        {"recentre_begins_an_epoch"},
        "at no other time",
    ),
    "float seconds": (
        spoil(pose_t=lambda s: s.pose_t / 1e9),
        {"poses_arrive"},
        "240 ns coarse",
    ),
}


@pytest.mark.parametrize("how", FAULTS)
def test_a_device_with(how):
    spoilt, checks, says = FAULTS[how]
    outcomes = checked(spoilt)
    assert checks <= failed(outcomes)
    if how != "float seconds":
        assert failed(outcomes) == checks
    first = outcomes[sorted(checks)[0]]
    assert says in f"{first.what} {first.fix}"
    assert all(outcomes[name].fix for name in failed(outcomes))


def test_reading_that_waits_is_told():
    outcomes = checked(read_s=0.5)
    assert failed(outcomes) == {"reading_returns_at_once"}
    assert "read() takes 500 ms" in outcomes["reading_returns_at_once"].what


def test_what_builds_on_a_failed_check_is_not_checked_and_says_so():
    outcomes = checked(spoil(pose=by(UNITY)))
    assert failed(outcomes) == {"known_twist"}
    assert outcomes["loss_is_told"].status == "not checked"
    assert "isn't the one that was shown" in outcomes["loss_is_told"].what


class Stuck:
    """A device that hangs where it is told to, until the test is over."""

    def __init__(self, where, over):
        self.where, self.over = where, over

    def at(self, where):
        if where == self.where:
            self.over.wait(30.0)

    def __enter__(self):
        self.at("opening")
        return self

    def __exit__(self, *_):
        self.at("closing")

    def start(self, take):
        self.at("start()")

    def read(self):
        self.at("read()")
        return Columns({})

    def stop(self):
        self.at("stop()")


@pytest.mark.parametrize("where", ["opening", "start()", "read()", "stop()", "closing"])
def test_a_device_that_hangs_is_told_with_the_line(monkeypatch, where):
    monkeypatch.setattr(opening, "PATIENCE_S", 0.5)
    monkeypatch.setattr(opening, "RECORD_S", 0.1)
    over = threading.Event()
    spec = replace(
        SPEC,
        open=lambda *_: Stuck(where, over),
        stand_in=lambda _: contextlib.nullcontext({}),
    )
    tried = type("Hangs", (HeadsetConformance,), {"name": "pico4", "thing": lambda: spec})
    try:
        with pytest.raises(NonconformityError, match=f"^{re.escape(where)} hangs at .*test_sour"):
            tried().test_poses_arrive()
        assert patience.hanging()
        with pytest.raises(NotCheckedError, match="nothing was recorded"):
            tried().test_known_twist()
    finally:
        over.set()


def test_closing_that_raises_is_told():
    outcomes = checked(closed_again=ValueError("not open"))
    assert failed(outcomes) == {"closing_twice"}
    assert "ValueError: not open" in outcomes["closing_twice"].what


def test_cameras_on_walls_recentre_nothing_and_their_clock_may_be_followed():
    recorded = rehearsed(recentres=False, followed=True)

    class Cameras(MocapConformance):
        name = "vicon"

        @classmethod
        def recorded(cls):
            return recorded

    for check in ("known_twist", "loss_is_told", "stamps_never_go_back", "rate_is_as_declared"):
        getattr(Cameras(), f"test_{check}")()


def test_a_profile_whose_levels_name_no_camera_is_told(monkeypatch):
    profile = HeadsetProfile(RATE, {0: "front"}, occlusion={"two": (0, 3)})

    class Levels(HeadsetConformance):
        name = "pico4"

        @classmethod
        def thing(cls):
            return replace(SPEC, profile=profile)

    with pytest.raises(NonconformityError, match=r"level 'two' covers cameras \[0, 3\]"):
        Levels().test_profile_is_sound()


def test_open_options_are_told():
    class Loose(BaseModel):
        host: str = "here"

    check_options(Options)
    with pytest.raises(NonconformityError, match='extra="forbid"'):
        check_options(Loose)
    with pytest.raises(NonconformityError, match="pydantic model"):
        check_options({"host": "here"})


def test_a_device_without_a_stand_in_is_not_checked_and_says_so():
    class Without(HeadsetConformance):
        name = "pico4"

        @classmethod
        def thing(cls):
            return SPEC

    with pytest.raises(NotCheckedError, match="has no stand-in"):
        Without().test_known_twist()


def test_a_name_that_nobody_offers_says_what_there_is(monkeypatch):
    monkeypatch.setenv("VRBENCH_PLUGINS", "")

    class Gone(HeadsetConformance):
        name = "gone"

    with pytest.raises(NonconformityError, match=r"no headset is called 'gone': there are sim\. I"):
        Gone().test_name_and_title()
