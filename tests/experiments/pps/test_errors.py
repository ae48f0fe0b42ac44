"""Robots that err: none errs without sources, each source errs, and what is felt and seen errs by its own."""

import numpy as np
import pytest
from data import SEED

from control.fixation import gaze_at
from learning.pps.touch_trial import TouchTrial
from pps_vision.experiments.pps.errors import SOURCES, Belief, ErrorSources, only
from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.skin import icub_skin, touched_taxels
from pps_vision.types import Array

SKIN = icub_skin()


@pytest.fixture(scope="module")
def trial() -> TouchTrial:
    """A ball comes straight down the normal of an inner taxel at 10 cm/s."""
    robot = load_icub()
    q = home(robot)
    positions, normals = SKIN.at(robot.at(q))
    left_s = np.arange(10, -1, -1) * 0.05
    path = positions[1] + (0.03 + 0.1 * left_s[:, None]) * normals[1]
    joints = np.tile(gaze_at(robot, q, path[5]), (len(path), 1))
    touched = touched_taxels(positions, path[-1], 0.03)
    velocity = np.tile(-0.1 * normals[1], (len(path), 1))
    at_rest = np.zeros((len(path), 3, 3)), np.full(len(path), 0.03)
    return TouchTrial(0.5 - left_s, joints, path, velocity, *at_rest, touched, SKIN.taxel_ids[1])


def relative(belief: Belief, told: TouchTrial) -> Array:
    """Where the object ends as seen from the taxels (n, 3)."""
    taxels, _ = belief.skin.at(belief.robot.at(told.joints_rad[-1]))
    end: Array = told.positions[-1] - taxels
    return end


@pytest.mark.parametrize("sees", [True, False])
def test_a_robot_without_errors_takes_everything_for_what_it_is(trial: TouchTrial, sees: bool) -> None:
    rng = np.random.default_rng(SEED)
    told = Belief.draw(only(), SKIN, rng).tells(trial, sees, rng)
    np.testing.assert_allclose(told.positions, trial.positions, atol=1e-6)
    np.testing.assert_allclose(told.velocities, trial.velocities, atol=1e-5)
    np.testing.assert_array_equal(told.joints_rad, trial.joints_rad)


@pytest.mark.parametrize("source", SOURCES)
def test_every_source_moves_what_is_seen_from_the_taxels(trial: TouchTrial, source: str) -> None:
    rng = np.random.default_rng(SEED)
    true, erring = (Belief.draw(sources, SKIN, rng) for sources in (only(), only(source)))
    off = relative(erring, erring.tells(trial, True, rng)) - relative(true, trial)
    assert 0.0005 < np.median(np.linalg.norm(off, axis=1)) < 0.1


def test_together_they_are_several_centimetres(trial: TouchTrial) -> None:
    rng = np.random.default_rng(SEED)
    true = relative(Belief.draw(only(), SKIN, rng), trial)
    beliefs = [Belief.draw(ErrorSources(), SKIN, rng) for _ in range(8)]
    off = [np.linalg.norm(relative(b, b.tells(trial, True, rng)) - true, axis=1).mean() for b in beliefs]
    assert 0.01 < np.median(off) < 0.08


def test_slack_differs_from_trial_to_trial_and_the_rest_does_not(trial: TouchTrial) -> None:
    rng = np.random.default_rng(SEED)
    for sources, same in ((only("joint calibration"), True), (only("backlash, elasticity"), False)):
        belief = Belief.draw(sources, SKIN, rng)
        once, again = (belief.tells(trial, True, rng).positions for _ in range(2))
        assert np.allclose(once, again) is same


def test_what_the_finger_feels_does_not_depend_on_the_cameras(trial: TouchTrial) -> None:
    rng = np.random.default_rng(SEED)
    told = Belief.draw(only("cameras"), SKIN, rng).tells(trial, False, rng)
    np.testing.assert_allclose(told.positions, trial.positions, atol=1e-6)
