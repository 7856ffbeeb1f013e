import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from vrbench import geometry
from vrbench.geometry import (
    Transform,
    continuous_signs,
    cross,
    matrix_to_quat,
    mean_rotation,
    quat_angle,
    quat_conjugate,
    quat_multiply,
    quat_normalize,
    quat_rotate,
    quat_to_matrix,
    quat_to_rotvec,
    relative_angle,
    rotvec_to_quat,
    slerp,
    unity_to_openxr,
)

TIGHT = 1e-12

components = arrays(np.float64, 4, elements=st.floats(-1, 1, allow_subnormal=False))
quaternions = components.filter(lambda q: np.linalg.norm(q) > 0.1).map(quat_normalize)
vectors = arrays(np.float64, 3, elements=st.floats(-10, 10, allow_subnormal=False))
transforms = st.builds(Transform, vectors, quaternions)


def random_quaternions(n: int, seed: int = 0) -> np.ndarray:
    return Rotation.random(n, random_state=seed).as_quat()


def assert_same_rotation(a, b, atol=TIGHT):
    """q and -q are one rotation."""
    sign = np.where(np.sum(np.asarray(a) * b, axis=-1, keepdims=True) < 0, -1.0, 1.0)
    np.testing.assert_allclose(a, sign * b, atol=atol, rtol=0)


def half_turns() -> np.ndarray:
    """Rotations by pi about the axes and diagonals, where w is 0."""
    axes = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, -1, 1], [1, 1, 1]], float)
    return np.pi * axes / np.linalg.norm(axes, axis=1, keepdims=True)


# scipy as the oracle


def test_products_are_scipys():
    a, b = random_quaternions(500, 1), random_quaternions(500, 2)
    expected = (Rotation.from_quat(a) * Rotation.from_quat(b)).as_quat()
    assert_same_rotation(quat_multiply(a, b), expected)


def test_turned_vectors_are_scipys():
    q, v = random_quaternions(500), np.random.default_rng(0).normal(size=(500, 3))
    np.testing.assert_allclose(quat_rotate(q, v), Rotation.from_quat(q).apply(v), atol=TIGHT)


def test_angles_are_scipys():
    a, b = random_quaternions(500, 1), random_quaternions(500, 2)
    expected = (Rotation.from_quat(a).inv() * Rotation.from_quat(b)).magnitude()
    np.testing.assert_allclose(relative_angle(a, b), expected, atol=TIGHT)
    np.testing.assert_allclose(quat_angle(a), Rotation.from_quat(a).magnitude(), atol=TIGHT)


def test_rotation_vectors_are_scipys():
    q = random_quaternions(500)
    r = Rotation.from_quat(q).as_rotvec()
    np.testing.assert_allclose(quat_to_rotvec(q), r, atol=TIGHT)
    assert_same_rotation(rotvec_to_quat(r), q)


def test_matrices_are_scipys():
    q = np.concatenate((random_quaternions(500), Rotation.from_rotvec(half_turns()).as_quat()))
    m = Rotation.from_quat(q).as_matrix()
    np.testing.assert_allclose(quat_to_matrix(q), m, atol=TIGHT)
    assert_same_rotation(matrix_to_quat(m), q)


def test_the_mean_is_scipys():
    spread = Rotation.from_rotvec(np.random.default_rng(3).normal(0, 0.3, (50, 3)))
    rotations = Rotation.random(random_state=3) * spread
    assert_same_rotation(mean_rotation(rotations.as_quat()), rotations.mean().as_quat(), 1e-9)


def test_the_mean_does_not_depend_on_signs():
    q = Rotation.from_rotvec(np.random.default_rng(3).normal(0, 0.3, (50, 3))).as_quat()
    signs = np.where(np.arange(50) % 2, -1.0, 1.0)[:, None]
    np.testing.assert_allclose(mean_rotation(q * signs), mean_rotation(q), atol=TIGHT)


# invariants of rotations


@given(quaternions, quaternions, quaternions)
def test_products_are_associative(a, b, c):
    left, right = quat_multiply(quat_multiply(a, b), c), quat_multiply(a, quat_multiply(b, c))
    np.testing.assert_allclose(left, right, atol=TIGHT)


@given(quaternions)
def test_a_rotation_and_its_inverse_cancel(q):
    np.testing.assert_allclose(quat_multiply(q, quat_conjugate(q)), [0, 0, 0, 1], atol=TIGHT)


@given(quaternions, quaternions, vectors)
def test_a_product_turns_by_the_second_and_then_the_first(a, b, v):
    turned = quat_rotate(a, quat_rotate(b, v))
    np.testing.assert_allclose(quat_rotate(quat_multiply(a, b), v), turned, atol=1e-11)


@given(quaternions, vectors)
def test_turning_keeps_lengths(q, v):
    assert np.linalg.norm(quat_rotate(q, v)) == pytest.approx(np.linalg.norm(v), abs=1e-11)


@given(quaternions)
def test_matrices_bring_the_rotation_back_with_w_not_negative(q):
    back = matrix_to_quat(quat_to_matrix(q))
    assert back[3] >= 0
    assert relative_angle(q, back) < 1e-9


@pytest.mark.parametrize("length", [0.0, 1e-300, 1e-13, 1e-9, 1e-6, 1e-3])
def test_small_rotation_vectors_come_back_to_full_relative_precision(length):
    r = length * np.array([0.36, -0.48, 0.8])
    np.testing.assert_allclose(quat_to_rotvec(rotvec_to_quat(r)), r, rtol=1e-14, atol=0)


@pytest.mark.parametrize("short_of_pi", [1e-3, 1e-6, 1e-9])
def test_rotation_vectors_come_back_just_short_of_half_a_turn(short_of_pi):
    r = half_turns() * (1 - short_of_pi / np.pi)
    np.testing.assert_allclose(quat_to_rotvec(rotvec_to_quat(r)), r, atol=TIGHT)


def test_rotation_vectors_past_half_a_turn_come_back_as_the_shorter_way_round():
    r = np.array([0.0, 1.5 * np.pi, 0.0])
    np.testing.assert_allclose(quat_to_rotvec(rotvec_to_quat(r)), [0, -np.pi / 2, 0], atol=TIGHT)


@pytest.mark.parametrize("angle", [1e-12, 1e-8, 1e-4, 1.0, np.pi])
def test_angles_are_exact_small_and_large_and_blind_to_sign(angle):
    q = rotvec_to_quat(np.array([0.0, angle, 0.0]))
    assert quat_angle(q) == pytest.approx(angle, rel=1e-12)
    assert quat_angle(-q) == pytest.approx(angle, rel=1e-12)


# slerp and signs


@given(quaternions, quaternions)
def test_slerp_begins_and_ends_at_its_ends(a, b):
    assert relative_angle(slerp(a, b, np.array(0.0)), a) < 1e-9
    assert relative_angle(slerp(a, b, np.array(1.0)), b) < 1e-9


@given(quaternions, quaternions, st.floats(0, 1))
def test_slerp_goes_the_short_way_at_a_steady_rate(a, b, u):
    between = slerp(a, b, np.array(u))
    assert np.linalg.norm(between) == pytest.approx(1.0, abs=TIGHT)
    whole = relative_angle(a, b)
    assert relative_angle(a, between) == pytest.approx(u * whole, abs=1e-7)
    assert relative_angle(between, b) == pytest.approx((1 - u) * whole, abs=1e-7)


@given(quaternions, quaternions, st.floats(0, 1))
def test_slerp_is_blind_to_the_signs_of_its_ends(a, b, u):
    # half a turn apart, both ways are as short
    if abs(a @ b) > 1e-6:
        at = np.array(u)
        assert relative_angle(slerp(a, b, at), slerp(-a, b, at)) < 1e-6


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-10, 1e-8, 1e-5, 1e-3])
def test_slerp_between_near_rotations_stays_exact(angle):
    a = random_quaternions(1)[0]
    b = quat_multiply(a, rotvec_to_quat(np.array([angle, 0.0, 0.0])))
    # a quarter: at the half, straight lines are exact too
    part = relative_angle(a, slerp(a, b, np.array(0.25)))
    assert part == pytest.approx(angle / 4, abs=1e-15)


@given(arrays(np.bool_, 30))
def test_continuous_signs_undo_any_flips(flipped):
    q = rotvec_to_quat(np.linspace(0, 2.5 * np.pi, 30)[:, None] * np.array([0.6, 0.0, 0.8]))
    flipped[0] = False
    spoilt = np.where(flipped[:, None], -q, q)
    np.testing.assert_array_equal(continuous_signs(spoilt), q)


@pytest.mark.parametrize("n", [0, 1])
def test_continuous_signs_of_nothing_and_of_one_are_themselves(n):
    q = -random_quaternions(3)[:n]
    np.testing.assert_array_equal(continuous_signs(q), q)


# transforms


@given(transforms, transforms)
def test_composition_is_that_of_matrices(a, b):
    np.testing.assert_allclose((a @ b).matrix(), a.matrix() @ b.matrix(), atol=1e-11)


@given(transforms)
def test_the_inverse_is_that_of_the_matrix(t):
    np.testing.assert_allclose(t.inverse().matrix(), np.linalg.inv(t.matrix()), atol=1e-10)


@given(transforms, vectors)
def test_points_go_to_the_parent_and_back(t, v):
    np.testing.assert_allclose(t.apply(v), (t.matrix() @ [*v, 1.0])[:3], atol=1e-11)
    np.testing.assert_allclose(t.inverse().apply(t.apply(v)), v, atol=1e-10)


@given(transforms)
def test_matrices_bring_the_transform_back(t):
    for matrix in (t.matrix(), t.matrix()[:3]):
        back = Transform.from_matrix(matrix)
        np.testing.assert_array_equal(back.p, t.p)
        assert_same_rotation(back.q, t.q, 1e-9)


def test_one_against_many_is_broadcast_from_both_sides():
    many = Transform(np.random.default_rng(0).normal(size=(5, 3)), random_quaternions(5))
    one = Transform.of([1, 2, 3], [0.1, 0.2, 0.3, 0.9])
    np.testing.assert_allclose((one @ many).matrix(), one.matrix() @ many.matrix(), atol=TIGHT)
    np.testing.assert_allclose((many @ one).matrix(), many.matrix() @ one.matrix(), atol=TIGHT)


def test_the_identity_changes_nothing():
    t = Transform.of([1, 2, 3], [0.1, 0.2, 0.3, 0.9])
    for same in (t @ Transform.identity(), Transform.identity() @ t):
        np.testing.assert_array_equal(same.matrix(), t.matrix())


def test_parts_are_joined_in_order():
    many = Transform(np.random.default_rng(0).normal(size=(5, 3)), random_quaternions(5))
    joined = Transform.concatenate(iter([many[:2], many[2:]]))
    np.testing.assert_array_equal(joined.p, many.p)
    np.testing.assert_array_equal(joined.q, many.q)
    assert len(joined) == 5


# Unity


@given(transforms)
def test_unity_and_back_is_where_it_began(t):
    twice = unity_to_openxr(unity_to_openxr(t))
    np.testing.assert_array_equal(twice.p, t.p)
    np.testing.assert_array_equal(twice.q, t.q)


@given(transforms, vectors)
def test_a_point_of_unity_is_mirrored_as_a_whole(t, v):
    # mirroring before or after the pose is applied is one and the same, and so distances are kept
    mirror = np.array([1.0, 1.0, -1.0])
    converted = unity_to_openxr(t).apply(v * mirror)
    np.testing.assert_allclose(converted, t.apply(v) * mirror, atol=1e-11)


def test_a_turn_right_in_unity_is_a_turn_right_in_openxr():
    # Unity turns left-handedly: 90 deg about y turns its +z (ahead) to +x (right);
    # in OpenXR, where -z is ahead, -z must then go to +x
    right = Transform(np.zeros(3), np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]))
    ahead = unity_to_openxr(right).apply(np.array([0.0, 0.0, -1.0]))
    np.testing.assert_allclose(ahead, [1, 0, 0], atol=TIGHT)


def test_up_and_right_stay_and_ahead_is_minus_z():
    converted = unity_to_openxr(Transform.of([1, 2, 3], [0, 0, 0, 1]))
    np.testing.assert_array_equal(converted.p, [1, 2, -3])
    np.testing.assert_allclose(np.linalg.det(converted.matrix()[:3, :3]), 1.0)


@pytest.mark.parametrize("single", [False, True])
def test_blocks_give_the_same_bits_as_rows_one_by_one(monkeypatch, single: bool) -> None:
    rng = np.random.default_rng(4)
    a, b = random_quaternions(23, 1), random_quaternions(23, 2)
    v, u = rng.normal(size=(23, 3)), rng.uniform(size=23)
    if single:
        a = a[0]
    calls = [
        lambda: quat_multiply(a, b),
        lambda: quat_rotate(a, v),
        lambda: relative_angle(a, b),
        lambda: slerp(a, b, u),
        lambda: slerp(a, b, 0.3),
        lambda: quat_to_rotvec(b),
        lambda: rotvec_to_quat(v),
        lambda: quat_to_matrix(b),
        lambda: cross(a[..., :3], v),
        lambda: (Transform(v, b) @ Transform(v[0], b[0])).p,
        lambda: quat_multiply(b[:, None], b[None]),
    ]
    whole = [call() for call in calls]
    monkeypatch.setattr(geometry, "BLOCK", 5)
    for call, expected in zip(calls, whole, strict=True):
        np.testing.assert_array_equal(call(), expected, strict=True)


def test_the_cross_product_is_numpy_s() -> None:
    a, b = np.random.default_rng(5).normal(size=(2, 50, 3))
    np.testing.assert_array_equal(cross(a, b), np.cross(a, b))
    np.testing.assert_array_equal(cross(a[0], b), np.cross(a[0], b))
