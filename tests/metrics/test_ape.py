import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vrbench.errors import EstimationError
from vrbench.geometry import Transform, rotvec_to_quat
from vrbench.metrics import ape
from vrbench.metrics.compared import fit_poses
from vrbench.metrics.pose_errors import ape_rotation, ape_translation
from vrbench.metrics.summary import STATISTICS, statistics

numbers = st.floats(-2, 2)
rigid = st.builds(
    lambda p, r: Transform(np.array(p), rotvec_to_quat(np.array(r))),
    st.tuples(numbers, numbers, numbers),
    st.tuples(numbers, numbers, numbers),
)


def shifted(dx, dr=0.0):
    """Errors of dx metres along base's x and dr radians about its z, from 10 s on."""

    def spoil(s, pose):
        late = (s > 10.0)[:, None]
        turn = rotvec_to_quat(np.where(late, [0, 0, dr], [0, 0, 0.0]))
        turned = Transform(np.zeros((len(s), 3)), turn) @ Transform(np.zeros((len(s), 3)), pose.q)
        return Transform(pose.p + np.where(late, [dx, 0, 0], 0.0), turned.q)

    return spoil


def test_a_perfect_take_has_no_error_at_either_point(values, make_take):
    take = make_take()
    found = values(ape.FAMILY, take)
    for point in ("eye", "tcp"):
        for metric in ("ape.translation.aligned", "ape.rotation.aligned"):
            for statistic in STATISTICS:
                value = found[metric, point, "all", statistic]
                assert value.value == pytest.approx(0.0, abs=1e-6)
                assert value.samples == len(take.estimate)


def test_anchored_fits_the_anchor_and_scores_the_rest(values, make_take):
    anchor_end = int(make_take().reference.t[0] + 10 * 10**9)
    take = make_take(spoil=shifted(0.004, np.radians(0.5)), anchor_end=anchor_end)
    found = values(ape.FAMILY, take)
    shift = found["ape.translation.anchored", "eye", "all", "rmse"]
    assert shift.value == pytest.approx(4.0, abs=1e-6)
    assert shift.samples < len(take.estimate)
    assert found["ape.rotation.anchored", "tcp", "all", "mean"].value == pytest.approx(
        0.5, abs=1e-6
    )
    # Aligned over both halves, the same shift shows as about half of it.
    assert found["ape.translation.aligned", "eye", "all", "rmse"].value < 2.1


def test_sitting_takes_the_calibrations_frame_as_it_is(values, make_take):
    def spoil(_s, pose):
        return Transform(pose.p + np.array([0, 0.003, 0]), pose.q)

    found = values(ape.FAMILY, make_take(spoil=spoil, sitting_y=make_take().y))
    assert found["ape.translation.sitting", "tcp", "all", "rmse"].value == pytest.approx(3.0)
    assert found["ape.translation.aligned", "tcp", "all", "rmse"].value == pytest.approx(
        0, abs=1e-6
    )


def test_what_is_missing_is_a_reason_and_never_a_number(values, make_take):
    found = values(ape.FAMILY, make_take(x=None))
    assert {value.value for value in found.values()} == {None}
    assert found["ape.translation.aligned", "", "all", "rmse"].reason.startswith("the mount has no")
    at_rest = make_take(
        path=lambda s: Transform(np.zeros((len(s), 3)), np.tile([0, 0, 0, 1.0], (len(s), 1)))
    )
    assert values(ape.FAMILY, at_rest)["ape.translation.aligned", "", "all", "rmse"].value is None


def test_every_valid_sample_counts_outliers_too(values, make_take):
    def spoil(s, pose):
        p = pose.p.copy()
        p[700] += [1.0, 0, 0]
        return Transform(p, pose.q)

    found = values(ape.FAMILY, make_take(spoil=spoil))
    assert found["ape.translation.aligned", "eye", "all", "max"].value > 900


def test_slope_against_speed_is_the_delay(values, make_take):
    delay = 0.004  # seconds, so 4 mm at 1 m/s and 4 deg at 1000 deg/s

    def path(s):
        turn = np.stack([0.0 * s, 0.0 * s, 0.8 * np.sin(s)], axis=1)
        p = np.stack([np.sin(s), 0.3 * np.cos(0.3 * s), 0.1 * s], axis=1)
        return Transform(p, rotvec_to_quat(turn))

    still = Transform.identity()
    take = make_take(path=path, x=still, spoil=lambda s, _: path(s - delay))
    found = values(ape.FAMILY, take)
    for metric in ("ape.translation.by_speed", "ape.rotation.by_speed"):
        assert found[metric, "eye", "all", "slope"].value == pytest.approx(4, rel=0.2)


def test_bands_part_slow_from_fast(values, make_take):
    def spoil(s, pose):
        slow, fast = 0.003 * np.sin(2 * np.pi * 0.45 * s), 0.001 * np.sin(2 * np.pi * 8 * s)
        return Transform(pose.p + np.stack([slow, fast, 0 * s], axis=1), pose.q)

    found = values(ape.FAMILY, make_take(60.0, spoil=spoil))
    name = "ape.translation.aligned"
    assert found[name, "eye", "<2Hz", "rmse"].value == pytest.approx(3 / np.sqrt(2), rel=0.03)
    assert found[name, "eye", ">2Hz", "rmse"].value == pytest.approx(1 / np.sqrt(2), rel=0.03)


@given(rigid, st.integers(0, 5))
@settings(deadline=None)
def test_ape_does_not_change_under_a_common_motion(move, seed):
    rng = np.random.default_rng(seed)
    a = Transform.of(rng.normal(size=(20, 3)), rng.normal(size=(20, 4)))
    b = Transform.of(rng.normal(size=(20, 3)), rng.normal(size=(20, 4)))
    np.testing.assert_allclose(
        ape_translation(move @ a, move @ b), ape_translation(a, b), atol=1e-9
    )
    np.testing.assert_allclose(ape_rotation(move @ a, move @ b), ape_rotation(a, b), atol=1e-9)


@given(rigid, st.integers(0, 5))
@settings(deadline=None)
def test_a_moved_copy_is_fitted_exactly_even_at_rest(move, seed):
    rng = np.random.default_rng(seed)
    poses = Transform.of(rng.normal(size=(20, 3)), rng.normal(size=(20, 4)))
    for truth in (poses, Transform(np.zeros((20, 3)), poses.q)):
        found = fit_poses(truth, move.inverse() @ truth)
        np.testing.assert_allclose((found @ move.inverse() @ truth).p, truth.p, atol=1e-9)
        np.testing.assert_allclose(ape_rotation(found, move), 0, atol=1e-9)


def test_no_samples_have_no_statistics():
    with pytest.raises(EstimationError, match="no samples"):
        statistics(np.zeros(0))


@given(st.lists(st.floats(0, 1e3), min_size=1, max_size=30))
def test_statistics_keep_their_order(error):
    s = statistics(np.array(error))
    slack = 1e-9 * (1 + s["max"])
    assert s["min"] <= s["median"] <= s["p95"] + slack <= s["max"] + 2 * slack
    assert s["mean"] <= s["rmse"] + slack <= s["max"] + 2 * slack
    assert s["sse"] == pytest.approx(len(error) * s["rmse"] ** 2)
