import pytest

from vrbench.geometry import Transform
from vrbench.metrics import handeye


def test_handeye_residuals_to_the_first_pose_carry_its_error(values, make_take):
    def spoil(s, pose):
        p = pose.p.copy()
        p[0] += [0.005, 0, 0]
        return Transform(p, pose.q)

    found = values(handeye.FAMILY, make_take(spoil=spoil))
    assert found["handeye.translation", "eye", "all", "median"].value == pytest.approx(0, abs=1e-6)
    to_first = found["handeye.translation.to_first", "tcp", "all", "mean"]
    assert to_first.value == pytest.approx(5, abs=0.01)
    assert found["handeye.rotation", "eye", "all", "max"].value == pytest.approx(0, abs=1e-5)
