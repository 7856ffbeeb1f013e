import numpy as np
import pytest

from vrbench.estimation.interpolation import PoseSpline
from vrbench.geometry import Transform, quat_multiply, rotvec_to_quat
from vrbench.statistics.floor import interpolation_term, noise_floor, x_term
from vrbench.trajectory import NS, Trajectory

X = Transform.of([0.0, 0.09, 0.28], [0.7, 0.0, 0.0, 0.7])


def motion(rate=30.0, duration=60.0):
    s = np.arange(0, duration, 1 / rate)
    p = np.stack([0.3 * np.sin(2 * s), 0.2 * np.sin(3 * s), 0.1 * np.cos(1.7 * s)], axis=1)
    r = np.stack([0.6 * np.sin(s), 0.4 * np.sin(1.3 * s), 0.9 * np.sin(0.7 * s)], axis=1)
    return Trajectory(np.rint(s * NS).astype(np.int64), Transform(p, rotvec_to_quat(r)))


def draws(sigma_m, sigma_rad, n=100):
    rng = np.random.default_rng(0)
    turn = rotvec_to_quat(rng.normal(0, sigma_rad, (n, 3)))
    return Transform(X.p + rng.normal(0, sigma_m, (n, 3)), quat_multiply(X.q, turn))


def test_a_certain_x_costs_nothing_and_a_doubtful_one_in_proportion():
    tcp = motion().pose
    assert x_term(tcp, X, draws(0, 0), "eye") == pytest.approx(0, abs=1e-9)
    once, twice = (x_term(tcp, X, draws(s, 0), "eye") for s in (0.001, 0.002))
    assert twice == pytest.approx(2 * once, rel=0.01)
    # What doesn't turn with the head is absorbed by the alignment.
    assert 0 < once < 0.001 * np.sqrt(3)


def test_the_lever_makes_rotation_cost_at_the_tcp_alone():
    tcp = motion().pose
    assert x_term(tcp, X, draws(0, 0.003), "eye") == pytest.approx(0, abs=1e-9)
    assert x_term(tcp, X, draws(0, 0.003), "tcp") > 1e-4


def test_interpolation_is_judged_from_every_other_sample():
    predicted = interpolation_term(motion(rate=15.0))
    fine = motion(rate=30.0)
    spline = PoseSpline(fine[::2])
    between = fine[31:-31:2]
    missed = spline.at(between.t).p - between.pose.p
    assert predicted == pytest.approx(np.sqrt(np.mean(np.sum(missed**2, axis=1))), rel=0.2)


def test_the_terms_add_in_squares():
    floor = noise_floor(
        motion(),
        X,
        draws(0.0005, 0.001),
        "tcp",
        reference_accuracy_m=0.0003,
        offset_sigma_s=0.001,
    )
    terms = [floor.reference, floor.x, floor.offset, floor.interpolation]
    assert floor.total == pytest.approx(np.sqrt(np.sum(np.square(terms))))
    speed = motion().speed()
    assert floor.offset == pytest.approx(0.001 * np.sqrt(np.mean(speed**2)))
    assert min(terms) > 0
    with pytest.raises(ValueError, match="eye or tcp"):
        x_term(motion().pose, X, draws(0, 0), "nose")
