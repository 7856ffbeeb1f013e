import pytest

from vrbench.geometry import Transform
from vrbench.metrics import scale


def test_scale_is_reference_over_estimate(values, make_take):
    take = make_take(spoil=lambda _, pose: Transform(pose.p / 1.01, pose.q))
    assert values(scale.FAMILY, take)["scale", "eye", "all", "value"].value == pytest.approx(1.01)
