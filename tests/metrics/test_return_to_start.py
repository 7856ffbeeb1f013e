import numpy as np
import pytest

from vrbench.geometry import Transform
from vrbench.metrics import return_to_start


def test_return_to_start_is_the_error_that_has_come_up(values, make_take):
    def spoil(s, pose):
        return Transform(pose.p + np.outer(s > 10, [0.003, 0.004, 0]), pose.q)

    found = values(return_to_start.FAMILY, make_take(spoil=spoil))
    for point in ("eye", "tcp"):
        row = found["return_to_start", point, "all", "last-first"]
        assert row.value == pytest.approx(5.0, abs=1e-6)
