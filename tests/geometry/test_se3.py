"""Rigid transforms obey the group's laws, also next to the identity and next to half a turn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from pps_vision.geometry.se3 import inverse, move_points, rotation_to, transform
from pps_vision.types import Array

coordinate = st.floats(-2.0, 2.0)
vectors = st.tuples(coordinate, coordinate, coordinate).map(np.array)
# ordinary turns, turns too small to see in the cosine, and turns that almost reach π
angles = st.one_of(st.floats(0.0, np.pi), st.floats(0.0, 1e-7), st.floats(0.0, 1e-7).map(lambda a: np.pi - a))
axes = vectors.filter(lambda v: np.linalg.norm(v) > 1e-3).map(lambda v: v / np.linalg.norm(v))
transforms = st.builds(
    lambda axis, a, t: transform(Rotation.from_rotvec(axis * a).as_matrix(), t), axes, angles, vectors
)


def as_scipy(T: Array) -> RigidTransform:
    return RigidTransform.from_matrix(T)


@given(transforms)
def test_inverse_is_the_groups_inverse_and_scipys(T_a_b):
    np.testing.assert_allclose(inverse(T_a_b) @ T_a_b, np.eye(4), atol=1e-14)
    np.testing.assert_allclose(T_a_b @ inverse(T_a_b), np.eye(4), atol=1e-14)
    np.testing.assert_allclose(inverse(T_a_b), as_scipy(T_a_b).inv().as_matrix(), atol=1e-14)


@given(transforms, transforms, vectors)
def test_neighbouring_names_cancel(T_a_b, T_b_c, p_c):
    once = move_points(T_a_b @ T_b_c, p_c)
    np.testing.assert_allclose(once, move_points(T_a_b, move_points(T_b_c, p_c)), atol=1e-13)
    np.testing.assert_allclose(once, (as_scipy(T_a_b) * as_scipy(T_b_c)).apply(p_c), atol=1e-13)


def test_stacks_of_transforms_and_points_are_mapped_one_by_one(rng):
    rotations = Rotation.random(6, rng=rng).as_matrix().reshape(2, 3, 3, 3)
    stack = np.zeros((2, 3, 4, 4))
    stack[..., :3, :3] = rotations
    stack[..., :3, 3] = rng.normal(size=(2, 3, 3))
    stack[..., 3, 3] = 1.0
    np.testing.assert_allclose(inverse(stack) @ stack, np.broadcast_to(np.eye(4), stack.shape), atol=1e-14)
    points = rng.normal(size=(4, 5, 3))
    moved = move_points(stack[0, 0], points)
    assert moved.shape == (4, 5, 3)
    np.testing.assert_allclose(moved[2, 3], (stack[0, 0] @ np.append(points[2, 3], 1.0))[:3], atol=1e-14)


@given(axes, st.floats(1e-6, 1e6))
def test_rotation_to_turns_z_onto_the_direction(axis, length):
    R = rotation_to(axis * length)
    np.testing.assert_allclose(R @ [0, 0, 1], axis, atol=1e-12)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


@pytest.mark.parametrize("direction", [(0.0, 0.0, 0.0), (np.nan, 0.0, 1.0), (np.inf, 0.0, 1.0)])
def test_rotation_to_refuses_a_direction_without_length(direction):
    with pytest.raises(ValueError, match="non-zero vector"):
        rotation_to(direction)
