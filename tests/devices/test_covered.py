"""The simulated headset while its cameras are covered, uncovered, and its user recentres."""

import numpy as np
import pytest

from vrbench.devices.ports import Occlusion, Session
from vrbench.devices.simulated.headset import Options, SimulatedHeadset
from vrbench.devices.simulated.stage import SimulatedOperator, Stage, VirtualClock
from vrbench.devices.specs import HeadsetProfile, Tracking
from vrbench.geometry import Transform
from vrbench.trajectory import Trajectory

NOMINAL = Transform.of((0.003, 0.087, 0.276), (0.70710678, 0.0, 0.0, 0.70710678))


class Lab:
    """A headset at rest, and hands."""

    def __init__(self, **tracking: float) -> None:
        self.host, self.stage = VirtualClock(), Stage()
        still = Transform(np.zeros((1, 3)), np.array([[0.0, 0.0, 0.0, 1.0]]))
        self.stage.move(Trajectory(np.array([self.host.now()]), still))
        profile = HeadsetProfile(
            72.0,
            cameras=dict.fromkeys(range(4), "camera"),
            occlusion={"none": (), "two": (0, 3)},
            tracking=Tracking(**{"lost_per_minute": 0.0, **tracking}),
        )
        self.headset = SimulatedHeadset(
            Options(), profile, Session(self.host, NOMINAL, 3, self.stage)
        )
        self.profile = profile
        self.hands = SimulatedOperator(self.stage, self.host)
        self.headset.start("take")

    def after(self, seconds: float):
        """What has been sent in the seconds that follow."""
        self.host.wait(seconds)
        return self.headset.read().poses["headset/eye"]

    def cover(self, level: str) -> None:
        found = self.profile.covered(level)
        assert found is not None
        self.hands.cover(found)


def spread(samples) -> float:
    return float(np.sqrt(np.mean(np.sum((samples.pose.p - samples.pose.p.mean(axis=0)) ** 2, 1))))


def test_levels_are_those_of_the_profile_and_the_two_that_all_have():
    profile = Lab().profile
    assert profile.covered("none") == Occlusion("none", {}, 0.0)
    assert profile.covered("two") == Occlusion("two", {0: "camera", 3: "camera"}, 0.5)
    assert profile.covered("all").share == 1.0
    assert profile.covered("five") is None
    assert HeadsetProfile(72.0).covered("all").share == 1.0  # a model whose cameras aren't known


def test_noise_grows_with_the_share_of_cameras_covered():
    lab = Lab(correlation_s=0.2, occlusion_growth=1.6)
    clear = lab.after(60.0)
    lab.cover("two")
    covered = lab.after(60.0)
    assert covered.good.all()
    assert spread(covered) / spread(clear) == pytest.approx(1.8, rel=0.1)


def test_with_all_cameras_covered_it_is_lost_and_found_again_elsewhere():
    still = {"position_noise_m": 0.0, "position_jitter_m": 0.0, "rotation_noise_rad": 0.0}
    lab = Lab(**still, relocalisation_s=1.5, relocalisation_m=0.01)
    before = lab.after(2.0)
    lab.cover("all")
    assert not lab.after(3.0).good.any()
    lab.cover("none")
    again = lab.after(4.0)
    found = again.good
    assert np.count_nonzero(~found) / 72.0 == pytest.approx(1.5, abs=0.03)
    assert np.all(np.diff(found.astype(int)) >= 0)
    jump = again.pose.p[-1] - before.pose.p[-1]
    assert jump == pytest.approx(lab.stage.truth["headset"]["relocated_m"][0], abs=1e-6)


def test_a_recentre_by_hand_begins_an_epoch_and_is_told():
    lab = Lab()
    assert set(lab.after(2.0).epoch) == {0}
    lab.hands.recentre()
    lab.host.wait(2.0)
    columns = lab.headset.read()
    assert set(columns.poses["headset/eye"].epoch) == {1}
    assert [event.kind for event in columns.events] == ["recentre"]
    assert len(lab.stage.truth["headset"]["base_worlds"]) == 2
