"""The emulated headset, and what hands do to it."""

import time

import numpy as np
import pytest

from vrbench.devices.emulated import EmulatedHead
from vrbench.devices.specs import Tracking
from vrbench.geometry import Transform
from vrbench.trajectory import NS

STILL = Transform.of([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])


class Rest:
    """A robot that stands still."""

    def at(self, t):
        return Transform(np.tile(STILL.p, (len(t), 1)), np.tile(STILL.q, (len(t), 1)))


def head_of(**tracking) -> EmulatedHead:
    return EmulatedHead(Rest(), STILL, 3, Tracking(**tracking))


def after(seconds: float, count: int = 400) -> np.ndarray:
    """Times over a second, so long after now [ns]."""
    return time.perf_counter_ns() + np.rint(np.linspace(seconds, seconds + 1.0, count) * NS).astype(
        np.int64
    )


def test_covered_wholly_it_is_lost_and_finds_itself_again_a_little_off():
    head = head_of(
        position_noise_m=0.0,
        position_jitter_m=0.0,
        relocalisation_s=2.0,
        relocalisation_m=0.05,
    )
    before, known = head.eye(after(0.0))
    assert known.all()
    head.obey("cover 1")
    assert not head.eye(after(0.1))[1].any()
    head.obey("uncover\n")
    assert not head.eye(after(0.1))[1].any()
    again, known = head.eye(after(2.1))
    assert known.all()
    assert 0.005 < np.linalg.norm(again.p[0] - before.p[0]) < 0.3


def test_with_half_its_cameras_covered_it_errs_more():
    head = head_of(correlation_s=0.01, occlusion_growth=1.6)
    clear, _ = head.eye(after(0.0))
    head.obey("cover 0.5")
    covered, known = head.eye(after(0.1))
    assert known.all()
    spread = [np.std(pose.p - pose.p.mean(axis=0)) for pose in (clear, covered)]
    assert spread[1] / spread[0] == pytest.approx(1.8, rel=0.2)


def test_fixed_anew_it_sits_otherwise_and_the_same_seed_sits_the_same():
    head, other = head_of(), head_of()
    first = head.x
    head.obey("remount")
    assert np.linalg.norm(head.x.p - first.p) > 1e-4
    np.testing.assert_array_equal(other.x.p, first.p)


@pytest.mark.parametrize("line", ["cover", "cover 2", "cover all", "shake", ""])
def test_what_hands_cannot_do_is_said(line):
    with pytest.raises(ValueError, match=r"could not convert|there are cover SHARE"):
        head_of().obey(line)
