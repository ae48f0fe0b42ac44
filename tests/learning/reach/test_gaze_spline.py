"""The spline through scattered gaze postures: exact on linear functions, smooth, defined for degenerate nodes."""

import numpy as np
import pytest

from learning.reach.lattice import GazeSpline, isotropic
from pps_vision.robot.gaze import GazeLimits

LIMITS = GazeLimits()


def gaze(n, seed=0):
    return np.random.default_rng(seed).uniform(LIMITS.lower, LIMITS.upper, (n, 3))


def test_nodes_are_met_and_between_them_it_follows_a_smooth_function():
    nodes = gaze(3000)
    queries = gaze(200, 1) * 0.8 + 0.1 * (LIMITS.lower + LIMITS.upper)
    spline = GazeSpline(nodes, np.sin(3 * nodes).sum(axis=1))
    np.testing.assert_allclose(spline(nodes[:50]), np.sin(3 * nodes[:50]).sum(axis=1), atol=1e-9)
    assert np.sqrt(np.mean((spline(queries) - np.sin(3 * queries).sum(axis=1)) ** 2)) < 3e-3
    assert spline(np.zeros((0, 3))).shape == (0,)


def test_a_linear_function_is_exact():
    nodes = gaze(100)
    slope = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(
        GazeSpline(nodes, isotropic(nodes) @ slope)(gaze(50, 1)), isotropic(gaze(50, 1)) @ slope, atol=1e-6
    )


def test_of_repeated_nodes_the_first_counts_and_repeated_queries_are_answered_alike():
    nodes = gaze(100)
    values = isotropic(nodes) @ [1.0, 2.0, 3.0]
    repeated = GazeSpline(np.concatenate([nodes, nodes]), np.concatenate([values, -values]))
    queries = np.repeat(gaze(5, 1), 3, axis=0)
    np.testing.assert_allclose(repeated(queries), isotropic(queries) @ [1.0, 2.0, 3.0], atol=1e-6)


def test_nodes_on_a_plane_say_nothing_across():
    nodes = gaze(100) * [1, 1, 0] + [0, 0, 0.5]
    spline = GazeSpline(nodes, 1 + nodes[:, 0])
    queries = gaze(50, 1) * 0.5 + [0, 0, 0.2]
    on = queries * [1, 1, 0] + [0, 0, 0.5]
    np.testing.assert_allclose(spline(on), 1 + on[:, 0], atol=0.05)
    across = np.array([0, 0, 0.1])
    above = isotropic(on) + across
    below = isotropic(on) - across
    up, down = (spline(np.c_[at[:, :2], 2 * np.arctan(np.exp(at[:, 2]))]) for at in (above, below))
    np.testing.assert_allclose(up, down, atol=1e-9)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_fewer_than_four_nodes(n):
    nodes = gaze(n)
    values = np.arange(2.0, 2.0 + n)
    spline = GazeSpline(nodes, values)
    np.testing.assert_allclose(spline(nodes), values, atol=1e-9)
    assert np.isfinite(spline(gaze(20, 1))).all()
    assert GazeSpline(nodes[:1], values[:1])(gaze(5, 1)) == pytest.approx(np.full(5, 2.0))


def test_no_nodes_are_refused():
    with pytest.raises(ValueError, match="no gaze postures"):
        GazeSpline(gaze(0), np.zeros(0))
