"""Straight paths by hand."""

import numpy as np
import pytest

from pps_vision.geometry.paths import arrival_s, passing_distances


def test_when_a_straight_path_first_comes_near_by_hand():
    points = np.array([[0.0, 0.0, 0.0], [0.04, 0.0, -0.2]])
    start = np.array([0.0, 0.0, 0.3])
    down = np.array([0.0, 0.0, -0.1])
    for aside_m, expected_s in (
        (0.0, (0.3 - 0.055) / 0.1),
        (0.033, (0.3 - np.sqrt(0.055**2 - 0.033**2)) / 0.1),
        (-0.06, np.inf),  # passes both
        (0.06, (0.5 - np.sqrt(0.055**2 - 0.02**2)) / 0.1),  # passes the first, meets the second
    ):
        position = start + np.array([aside_m, 0.0, 0.0])
        assert arrival_s(points, position, down, 0.055) == pytest.approx(expected_s)
    assert arrival_s(points, start, -down, 0.055) == np.inf
    assert arrival_s(points, start, 0 * down, 0.055) == np.inf
    np.testing.assert_array_equal(arrival_s(points[:1], start * [[1 / 6], [-1 / 6]], down, 0.055), [0.0, np.inf])


def test_how_near_an_object_passes_by_hand():
    """It flies along x for two seconds, past one point, short of another, and away from a third."""
    points = np.array([[0.1, 0.03, 0.04], [0.5, 0.0, 0.0], [-0.1, 0.0, 0.0]])
    passing = passing_distances(points, np.zeros(3), np.array([0.2, 0.0, 0.0]), 2.0)
    np.testing.assert_allclose(passing, [0.05, 0.1, 0.1])
    np.testing.assert_allclose(passing_distances(points, np.zeros(3), np.zeros(3), 2.0), [np.sqrt(0.0125), 0.5, 0.1])


def test_a_path_that_ends_at_the_skin_misses_what_lies_beyond():
    """It comes down on the first point from 30 cm and ends 5 cm above it."""
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.2]])
    path = np.array([[0.0, 0.0, 0.3]]), np.array([[0.0, 0.0, -0.1]])
    np.testing.assert_allclose(passing_distances(points, *path), [[0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(passing_distances(points, *path, arrival_s(points, *path, 0.05)), [[0.05, 0.25]])
