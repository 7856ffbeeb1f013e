import numpy as np
import pytest

from vrbench.geometry import Transform, quat_multiply, rotvec_to_quat
from vrbench.metrics import jitter


def test_jitter_is_the_scatter_at_rest(values, make_take, stop_and_go):
    rng = np.random.default_rng(1)

    def spoil(s, pose):
        trembled = rotvec_to_quat(rng.normal(0, np.radians(0.02), (len(s), 3)))
        p = pose.p + rng.normal(0, 0.0003, pose.p.shape)
        return Transform(p, quat_multiply(pose.q, trembled))

    found = values(jitter.FAMILY, make_take(path=stop_and_go, spoil=spoil))
    position = found["jitter.position", "eye", "all", "rmse"]
    assert position.value == pytest.approx(0.3 * np.sqrt(3), rel=0.1)
    assert position.samples == pytest.approx(720, abs=2)
    rotation = found["jitter.rotation", "eye", "all", "rmse"]
    assert rotation.value == pytest.approx(0.02 * np.sqrt(3), rel=0.1)


def test_without_rest_there_is_no_jitter(values, make_take):
    found = values(jitter.FAMILY, make_take())
    assert "never at rest" in found["jitter.position", "", "all", "rmse"].reason
