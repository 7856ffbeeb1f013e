"""evo as the oracle: association, pairs, APE, RPE and their statistics, to 1e-9."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vrbench.estimation.alignment import align
from vrbench.geometry import Transform
from vrbench.metrics import pose_errors as errors
from vrbench.metrics import summary
from vrbench.metrics.as_evo import Delta, pairs
from vrbench.metrics.association import associate, nearest
from vrbench.metrics.pairs import end_to_end, pairs_by_path

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    pytest.importorskip("evo")
    from evo.core import filters, metrics, sync
    from evo.core.trajectory import PoseTrajectory3D

CLOSE = {"rtol": 1e-9, "atol": 1e-9}


def head(seed: int, n: int = 300, step: float = 0.01) -> Transform:
    rng = np.random.default_rng(seed)
    q = np.cumsum(rng.normal(0, 0.02, (n, 4)), axis=0) + np.array([0, 0, 0, 1.0])
    return Transform.of(np.cumsum(rng.normal(0, step, (n, 3)), axis=0), q)


def noisy(pose: Transform, seed: int) -> Transform:
    rng = np.random.default_rng(seed)
    return Transform.of(
        pose.p + rng.normal(0, 0.003, pose.p.shape), pose.q + rng.normal(0, 0.002, pose.q.shape)
    )


def as_evo(pose: Transform, t=None):
    t = np.arange(len(pose)) * 0.01 if t is None else t
    return PoseTrajectory3D(pose.p, pose.q[:, [3, 0, 1, 2]], t)


def assert_statistics(ours, theirs):
    ours = summary.statistics(ours)
    for name, value in theirs.get_all_statistics().items():
        np.testing.assert_allclose(ours[name], value, **CLOSE, err_msg=name)


# Multiples of 1/8 and few of them: ties and equal stamps are the rule.
stamps = st.lists(st.integers(0, 40), min_size=1, max_size=20).map(lambda x: np.array(x) / 8)


@given(stamps, stamps, st.sampled_from([0.125, 0.5, 2.0]), st.sampled_from([0.0, 0.25, -1.0]))
def test_nearest_stamps_are_evos(a, b, max_diff, offset):
    b = np.sort(b)
    i, j = nearest(a, b + offset, max_diff)
    assert (i.tolist(), j.tolist()) == tuple(
        [int(k) for k in x] for x in sync.matching_time_indices(a, b, max_diff, offset)
    )


@given(
    st.lists(st.integers(0, 80), min_size=1, max_size=20, unique=True),
    st.lists(st.integers(0, 80), min_size=1, max_size=20, unique=True),
    st.sampled_from([0.125, 0.5, 2.0]),
)
@settings(deadline=None)
def test_association_is_evos(a, b, max_diff):
    a, b = np.sort(np.array(a) / 8), np.sort(np.array(b) / 8)
    reference, estimate = as_evo(head(1, len(a)), a), as_evo(head(2, len(b)), b)
    try:
        found_reference, found_estimate = sync.associate_trajectories(
            reference, estimate, max_diff=max_diff
        )
    except sync.SyncException:
        with pytest.raises(Exception, match="lie within"):
            associate(a, b, max_diff)
        return
    i, j = associate(a, b, max_diff)
    np.testing.assert_array_equal(head(1, len(a)).p[i], found_reference.positions_xyz)
    np.testing.assert_array_equal(head(2, len(b)).p[j], found_estimate.positions_xyz)


@pytest.mark.parametrize("aligned", [False, True])
def test_ape_is_evos(aligned):
    reference = head(3)
    estimate = Transform.of([0.3, -0.2, 1.0], [0.2, 0.1, -0.5, 0.8]) @ noisy(reference, 4)
    theirs = as_evo(estimate)
    if aligned:
        theirs.align(as_evo(reference))
        estimate = align(reference.p, estimate.p) @ estimate
    for relation, ours in (
        (metrics.PoseRelation.translation_part, errors.ape_translation(reference, estimate)),
        (metrics.PoseRelation.rotation_angle_rad, errors.ape_rotation(reference, estimate)),
    ):
        ape = metrics.APE(relation)
        ape.process_data((as_evo(reference), theirs))
        np.testing.assert_allclose(ours, ape.error, **CLOSE)
        assert_statistics(ours, ape)


@pytest.mark.parametrize("all_pairs", [False, True])
@pytest.mark.parametrize(
    ("delta", "unit"), [(1, "frames"), (7, "frames"), (0.2, "m"), (0.15, "rad"), (8.0, "deg")]
)
def test_rpe_is_evos(delta, unit, all_pairs):
    reference = head(5)
    estimate = noisy(reference, 6)
    found = pairs(estimate, None, Delta(delta, unit, all_pairs))
    ours = errors.rpe(reference, estimate, found)
    for relation, error in zip(
        (metrics.PoseRelation.translation_part, metrics.PoseRelation.rotation_angle_rad),
        ours,
        strict=True,
    ):
        rpe = metrics.RPE(relation, delta, metrics.Unit(unit), all_pairs=all_pairs)
        rpe.process_data((as_evo(reference), as_evo(estimate)))
        np.testing.assert_allclose(error, rpe.error, **CLOSE)
        assert_statistics(error, rpe)


# Steps of quarters of a metre, many of them nought: plateaus and ties are the rule.
paths = st.lists(st.sampled_from([0.0, 0.0, 0.25, 0.5, 1.25]), min_size=1, max_size=25)


@given(
    paths, st.sampled_from([0.25, 0.5, 0.625, 1.0, 2.0]), st.booleans(), st.sampled_from([0.1, 0.5])
)
def test_pairs_by_path_are_evos(steps, delta, all_pairs, tolerance):
    p = np.zeros((len(steps) + 1, 3))
    p[1:, 0] = np.cumsum(steps)
    matrices = list(Transform(p, np.tile([0.0, 0, 0, 1], (len(p), 1))).matrix())
    theirs = filters.filter_pairs_by_path(matrices, delta, tolerance * delta, all_pairs)
    if all_pairs:
        first, second = pairs_by_path(p, delta, tolerance * delta)
    else:
        first, second = end_to_end(np.linalg.norm(np.diff(p, axis=0), axis=1), delta)
    assert list(zip(first.tolist(), second.tolist(), strict=True)) == [
        (int(i), int(j)) for i, j in theirs
    ]
