"""The search looks left, right, up and down of its centre, within every limit."""

import numpy as np
import pytest

from control.fixation import gaze_at
from control.head import gaze_of
from control.search import SearchParams, SearchState, step
from pps_vision.robot.icub import home, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array

DEG = np.pi / 180
DT = 0.05


def look_around(robot: Robot, q: Array, n: int, seed: int) -> Array:
    """Gazes (n, 4) of a search about where `q` looks."""
    rng, params, gazes = np.random.default_rng(seed), SearchParams(), []
    state = SearchState(gaze_of(robot.at(q)))
    for _ in range(n):
        state, command = step(params, state, robot.at(q), DT, rng)
        q = q + DT * command.dq_rad_s
        assert np.all((q >= robot.lower_rad - 1e-9) & (q <= robot.upper_rad + 1e-9))
        gazes.append(gaze_of(robot.at(q)))
    return np.array(gazes)


def test_it_looks_to_all_sides_of_its_centre_at_its_own_speed(robot: Robot) -> None:
    q = gaze_at(robot, home(robot), (-0.4, 0.05, 0.25))
    center = gaze_of(robot.at(q))
    gazes = look_around(robot, q, 1200, seed=1)
    aside, up = gazes[:, 0] - center[0], gazes[:, 1] + gazes[:, 2] - center[1] - center[2]
    assert aside.min() < -20 * DEG
    assert aside.max() > 20 * DEG
    assert up.min() < -12 * DEG
    assert up.max() > 12 * DEG
    assert np.abs(aside).max() < 31 * DEG
    assert np.abs(up).max() < 21 * DEG
    assert np.abs(np.diff(gazes[:, :2], axis=0)).max() <= 30 * DEG * DT + 1e-9
    np.testing.assert_allclose(gazes[:, 3], center[3], atol=1e-9)


def test_below_the_necks_end_the_eyes_tilt_searches_on(robot: Robot) -> None:
    p = robot.at(home(robot)).point("left_forearm")
    gazes = look_around(robot, gaze_at(robot, home(robot), p), 600, seed=2)
    down = gazes[:, 1] + gazes[:, 2]
    assert down.min() < -60 * DEG
    assert gazes[:, 1].min() >= -40 * DEG - 1e-9


def test_held_for_half_a_second_no_joint_leaves_its_limits(robot: Robot) -> None:
    q = set_gaze(robot, home(robot), yaw=54 * DEG, pitch=29 * DEG, vergence=10 * DEG)
    ends = []
    for seed in range(20):
        state, rng = SearchState(gaze_of(robot.at(q))), np.random.default_rng(seed)
        _, command = step(SearchParams(), state, robot.at(q), 0.5, rng)
        ends.append(q + 0.5 * command.dq_rad_s)
        assert command.valid_s == 0.5
    assert np.all((np.array(ends) >= robot.lower_rad - 1e-9) & (np.array(ends) <= robot.upper_rad + 1e-9))
    assert np.max(ends, axis=0)[robot.indices(("neck_yaw",))] == pytest.approx(55 * DEG)


def test_equal_seeds_give_equal_searches(robot: Robot) -> None:
    q = home(robot)
    np.testing.assert_array_equal(look_around(robot, q, 50, seed=3), look_around(robot, q, 50, seed=3))
    assert not np.allclose(look_around(robot, q, 50, seed=3), look_around(robot, q, 50, seed=4))
