"""The spline through scattered gaze postures beside SciPy's, and where SciPy's has no solution."""

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from learning.reach.gaze_spline import GazeSpline
from learning.reach.map import isotropic
from pps_vision.robot.gaze import GazeLimits

LIMITS = GazeLimits()


def gaze(n, seed=0):
    return np.random.default_rng(seed).uniform(LIMITS.lower, LIMITS.upper, (n, 3))


def test_it_is_scipys():
    nodes, asked = gaze(400), gaze(200, 1)
    values = np.sin(3 * nodes).sum(axis=1)
    theirs = RBFInterpolator(isotropic(nodes), values, neighbors=30, kernel="cubic")(isotropic(asked))
    np.testing.assert_allclose(GazeSpline(nodes, values)(asked), theirs, atol=1e-5)
    assert GazeSpline(nodes, values)(np.zeros((0, 3))).shape == (0,)


def test_asked_twice_the_first_answer_stands():
    nodes = gaze(100)
    values = isotropic(nodes) @ [1.0, 2.0, 3.0]
    again = GazeSpline(np.concatenate([nodes, nodes]), np.concatenate([values, -values]))
    np.testing.assert_allclose(again(gaze(50, 1)), isotropic(gaze(50, 1)) @ [1.0, 2.0, 3.0], atol=1e-6)


def test_nodes_on_a_plane_say_nothing_across():
    nodes = gaze(100) * [1, 1, 0] + [0, 0, 0.5]
    spline, asked = GazeSpline(nodes, 1 + nodes[:, 0]), gaze(50, 1) * 0.5 + [0, 0, 0.2]
    on = asked * [1, 1, 0] + [0, 0, 0.5]
    np.testing.assert_allclose(spline(on), 1 + on[:, 0], atol=1e-5)
    across = np.array([0, 0, 0.1])
    above, below = isotropic(on) + across, isotropic(on) - across
    up, down = (spline(np.c_[at[:, :2], 2 * np.arctan(np.exp(at[:, 2]))]) for at in (above, below))
    np.testing.assert_allclose(up, down, atol=1e-4)


def test_few_nodes_or_none():
    assert GazeSpline(gaze(1), np.array([2.0]))(gaze(5, 1)) == pytest.approx(np.full(5, 2.0))
    with pytest.raises(ValueError, match="no gaze postures"):
        GazeSpline(gaze(0), np.zeros(0))
