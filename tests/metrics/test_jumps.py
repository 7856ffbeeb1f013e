import numpy as np
import pytest

from vrbench.geometry import Transform
from vrbench.metrics import jumps


def test_jumps_are_counted_and_sized(values, make_take):
    def spoil(s, pose):
        return Transform(pose.p + np.outer((s > 5) * 0.03 + (s > 12) * 0.02, [0, 1, 0]), pose.q)

    found = values(jumps.FAMILY, make_take(spoil=spoil))
    assert found["jumps", "eye", "all", "count"].value == 2
    assert found["jumps.size", "eye", "all", "max"].value == pytest.approx(30, abs=0.5)
    none = values(jumps.FAMILY, make_take())
    assert none["jumps", "eye", "all", "count"].value == 0
    assert none["jumps.size", "eye", "all", "max"].value is None
