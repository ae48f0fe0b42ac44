"""Rotations that turn z onto a direction."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pps_vision.geometry.se3 import rotation_to

coordinate = st.floats(-2.0, 2.0)
vectors = st.tuples(coordinate, coordinate, coordinate).map(np.array)
# ordinary turns, turns too small to see in the cosine, and turns that almost reach π
axes = vectors.filter(lambda v: np.linalg.norm(v) > 1e-3).map(lambda v: v / np.linalg.norm(v))


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
