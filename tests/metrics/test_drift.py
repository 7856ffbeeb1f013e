import numpy as np
import pytest

from vrbench.geometry import Transform
from vrbench.metrics import drift


def test_drift_is_split_into_translation_yaw_and_tilt(values, make_take, leaning, up_of):
    up = up_of(make_take())
    per_hour = np.radians(1.0) / 3600

    def spoil(s, pose):
        turned = leaning(-2 * per_hour, up)(s, pose)
        return Transform(pose.p + np.outer(s / 3600, [0.006, 0, 0.008]), turned.q)

    found = values(drift.FAMILY, make_take(900.0, rate=10.0, spoil=spoil))
    assert found["drift.translation", "eye", "all", "slope"].value == pytest.approx(10, rel=0.05)
    assert found["drift.yaw", "eye", "all", "slope"].value == pytest.approx(-2, rel=0.05)
    assert found["drift.tilt", "eye", "all", "slope"].value == pytest.approx(0, abs=0.02)


def test_a_short_take_has_no_drift(values, make_take):
    found = values(drift.FAMILY, make_take())
    assert "drift needs 600 s" in found["drift.yaw", "eye", "all", "slope"].reason
