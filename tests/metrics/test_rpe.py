import numpy as np
import pytest

from vrbench.geometry import Transform
from vrbench.metrics import rpe


def test_rpe_sees_drift_by_its_rate(values, make_take):
    def spoil(s, pose):
        return Transform(pose.p + np.outer(0.001 * s, [1, 0, 0]), pose.q)

    found = values(rpe.FAMILY, make_take(30.0, spoil=spoil))
    assert found["rpe.translation@1s", "eye", "all", "rmse"].value == pytest.approx(1, rel=0.01)
    assert found["rpe.translation@10s", "tcp", "all", "mean"].value == pytest.approx(10, rel=0.01)
    assert found["rpe.rotation@0.1s", "eye", "all", "max"].value == pytest.approx(0, abs=1e-6)


def test_rpe_of_a_short_take_says_so(values, make_take):
    found = values(rpe.FAMILY, make_take(5.0))
    assert "10 s apart" in found["rpe.translation@10s", "", "all", "rmse"].reason
