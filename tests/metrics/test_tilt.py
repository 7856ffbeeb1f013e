import numpy as np
import pytest

from vrbench.geometry import Transform, quat_multiply, rotvec_to_quat
from vrbench.metrics import tilt


def test_tilt_sees_leaning_and_not_yaw(values, make_take, leaning, up_of):
    up = up_of(make_take())
    across = np.cross(up, [1.0, 0, 0])
    across /= np.linalg.norm(across)
    rate = np.radians(0.1)
    leans = values(tilt.FAMILY, make_take(20.0, spoil=leaning(rate, across)))
    # Means of the first and the last five seconds lie 15 s apart.
    assert leans["tilt", "", "all", "last-first"].value == pytest.approx(1.5, rel=0.01)
    yaws = values(tilt.FAMILY, make_take(20.0, spoil=leaning(rate, up)))
    assert yaws["tilt", "", "all", "last-first"].value == pytest.approx(0, abs=1e-5)


def test_tilt_between_takes_is_measured_to_the_first(make_take, up_of):
    up = up_of(make_take())
    across = np.cross(up, [1.0, 0, 0])
    across /= np.linalg.norm(across)

    def leaned(_s, pose):
        turn = rotvec_to_quat(np.radians(0.3) * across)
        return Transform(pose.p, quat_multiply(np.broadcast_to(turn, pose.q.shape), pose.q))

    rows = {v.statistic: v for v in tilt.of_repeats([make_take(), make_take(spoil=leaned)])}
    assert rows["max"].value == pytest.approx(0.3, rel=1e-6)
