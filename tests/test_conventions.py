"""The maps between conventions, against the formulas of the engines' documentation."""

import numpy as np
import pytest

from vrbench.geometry import (
    OPENXR,
    ROS,
    UNITY,
    UNREAL,
    Axes,
    Transform,
    matrix_to_quat,
    quat_normalize,
    quat_rotate,
    quat_to_matrix,
    relative_angle,
    rotvec_to_quat,
)

RNG = np.random.default_rng(6)
N = 500
POSES = Transform(RNG.normal(size=(N, 3)), quat_normalize(RNG.normal(size=(N, 4))))


def unity_by_hand(x, y, z, qx, qy, qz, qw):
    return (x, y, -z), (-qx, -qy, qz, qw)


def unreal_by_hand(x, y, z, qx, qy, qz, qw):
    return (y / 100, z / 100, -x / 100), (-qy, -qz, qx, qw)


def ros_by_hand(x, y, z, qx, qy, qz, qw):
    return (-z, -x, y), (-qz, -qx, qy, qw)


def unity_ros_by_hand(x, y, z, qx, qy, qz, qw):
    return (z, -x, y), (-qz, qx, -qy, qw)


def unity_to_ros(pose):
    return ROS.from_openxr(UNITY.to_openxr(pose))


MAPS = [
    # the map, the same by hand, what it does to points (3, 3), the unit
    (UNITY.to_openxr, unity_by_hand, [[1, 0, 0], [0, 1, 0], [0, 0, -1]], 1.0),
    (UNREAL.to_openxr, unreal_by_hand, [[0, 1, 0], [0, 0, 1], [-1, 0, 0]], 0.01),
    (ROS.from_openxr, ros_by_hand, [[0, 0, -1], [-1, 0, 0], [0, 1, 0]], 1.0),
    (unity_to_ros, unity_ros_by_hand, [[0, 0, 1], [-1, 0, 0], [0, 1, 0]], 1.0),
]
each_map = pytest.mark.parametrize(
    ("convert", "by_hand", "points", "unit"), MAPS, ids=lambda x: getattr(x, "__name__", "")
)


@each_map
def test_poses_are_mapped_as_the_table_says(convert, by_hand, points, unit):
    p, q = by_hand(*POSES.p.T, *POSES.q.T)
    np.testing.assert_allclose(convert(POSES).p, np.column_stack(p), atol=1e-15)
    np.testing.assert_allclose(convert(POSES).q, np.column_stack(q), atol=1e-15)


@each_map
def test_rotations_stay_proper_and_are_conjugated_by_the_map_of_points(
    convert, by_hand, points, unit
):
    m, rotation = np.array(points, dtype=float), quat_to_matrix(POSES.q)
    converted = convert(POSES)
    matrices = quat_to_matrix(converted.q)
    np.testing.assert_allclose(np.linalg.det(matrices), 1.0, atol=1e-12)
    np.testing.assert_allclose(matrices, m @ rotation @ m.T, atol=1e-12)
    np.testing.assert_allclose(
        relative_angle(converted.q, matrix_to_quat(m @ rotation @ m.T)), 0.0, atol=1e-7
    )


@each_map
def test_a_point_of_the_child_goes_to_the_same_place(convert, by_hand, points, unit):
    m, child = np.array(points, dtype=float) * unit, RNG.normal(size=(N, 3))
    np.testing.assert_allclose(
        convert(POSES).apply(child @ m.T), POSES.apply(child) @ m.T, atol=1e-12
    )


@pytest.mark.parametrize("axes", [OPENXR, UNITY, UNREAL, ROS], ids=str)
def test_there_and_back_is_where_it_was(axes):
    again = axes.from_openxr(axes.to_openxr(POSES))
    np.testing.assert_allclose(again.p, POSES.p, atol=1e-13)
    np.testing.assert_allclose(again.q, POSES.q, atol=1e-15)
    one = axes.to_openxr(POSES[3])
    np.testing.assert_array_equal(one.p, axes.to_openxr(POSES).p[3])


QUARTER = np.pi / 2


@pytest.mark.parametrize(
    ("axes", "turn", "forward"),
    [
        # each engine's own turn to the right (heading +90 deg), and where it says forward is
        (OPENXR, (0, -QUARTER, 0), (0, 0, -1)),
        (UNITY, (0, QUARTER, 0), (0, 0, 1)),
        (UNREAL, (0, 0, QUARTER), (1, 0, 0)),
        (ROS, (0, 0, -QUARTER), (1, 0, 0)),
    ],
)
def test_a_turn_to_the_right_is_one_in_every_convention(axes, turn, forward):
    pose = Transform(np.array(forward, dtype=float), rotvec_to_quat(np.array(turn, dtype=float)))
    ours = axes.to_openxr(pose)
    np.testing.assert_allclose(ours.p, [0, 0, -axes.unit_m], atol=1e-15)
    # who looked ahead looks to the right, +x
    np.testing.assert_allclose(
        quat_rotate(ours.q, np.array([0.0, 0.0, -1.0])), [1, 0, 0], atol=1e-12
    )


@pytest.mark.parametrize(
    ("up", "forward", "handedness", "says"),
    [
        ("w", "x", "right", "an axis is x, y, z"),
        ("y", "-y", "right", "are one line"),
        ("y", "z", "both", "right or left"),
    ],
)
def test_axes_that_are_none_are_refused(up, forward, handedness, says):
    with pytest.raises(ValueError, match=says):
        Axes(up, forward, handedness)
