import numpy as np
import pytest

from vrbench.geometry import Transform, rotvec_to_quat
from vrbench.metrics import rest
from vrbench.trajectory import NS, Trajectory


def test_rest_is_found_where_it_is(make_take, stop_and_go):
    slots = rest.rest_slots(make_take(path=stop_and_go).reference)
    assert slots.tolist() == list(range(5, 15))


@pytest.mark.parametrize("mm_per_s", [0.3, 1.0, 10.0])
def test_creeping_is_not_rest(make_take, mm_per_s):
    def creep(s):
        p = np.outer(s, [mm_per_s / 1e3, 0, 0])
        return Transform(p, np.tile([0, 0, 0, 1.0], (len(s), 1)))

    assert len(rest.rest_slots(make_take(path=creep).reference)) == 0


def test_rest_is_found_through_the_noise_of_motion_capture():
    rng = np.random.default_rng(0)
    t = np.arange(1200, dtype=np.int64) * (NS // 120)
    pose = Transform(
        rng.normal(0, 0.6e-4, (1200, 3)), rotvec_to_quat(rng.normal(0, 5e-4, (1200, 3)))
    )
    assert len(rest.rest_slots(Trajectory(t, pose))) >= 9
