"""Robots that err: none without sources, each source displaces what is observed, calibration reduces it."""

import numpy as np
import pytest
from data import SEED

from control.double_touch import FINGERTIP_RADIUS_M
from control.fixation import gaze_at
from learning.pps.trials import TouchTrial
from pps_vision.experiments.pps.misaimed import misaimed_touches
from pps_vision.experiments.pps.robot_errors import (
    SOURCES,
    ErringRobot,
    ErrorSources,
    only,
)
from pps_vision.experiments.pps.trials import exact_trials
from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.skin import TOUCH_RADIUS_M, icub_skin, touched_taxels
from pps_vision.types import Array

SKIN = icub_skin()


def rng(k: int = 0) -> np.random.Generator:
    return np.random.default_rng((SEED, k))


@pytest.fixture(scope="module")
def trial() -> TouchTrial:
    """A ball approaches an inner taxel along its normal at 10 cm/s."""
    robot = load_icub()
    q = home(robot)
    positions, normals = SKIN.at(robot.at(q))
    left_s = np.arange(10, -1, -1) * 0.05
    path = positions[1] + (0.03 + 0.1 * left_s[:, None]) * normals[1]
    joints = np.tile(gaze_at(robot, q, path[5]), (len(path), 1))
    touched = touched_taxels(positions, path[-1], 0.03)
    velocity = np.tile(-0.1 * normals[1], (len(path), 1))
    certain = np.zeros((len(path), 3, 3)), np.full(len(path), 0.03)
    return TouchTrial(0.5 - left_s, joints, path, velocity, *certain, touched)


def end_from_taxels(robot: ErringRobot, observed: TouchTrial) -> Array:
    """Where the object ends relative to the taxels (n, 3)."""
    taxels, _ = robot.skin.at(robot.model.at(observed.joints_rad[-1]))
    end: Array = observed.positions[-1] - taxels
    return end


@pytest.mark.parametrize("sees", [True, False])
def test_without_errors_the_observation_is_the_truth(trial: TouchTrial, sees: bool) -> None:
    observed = ErringRobot.draw(only(), rng()).observe(trial, sees, rng())
    np.testing.assert_allclose(observed.positions, trial.positions, atol=1e-6)
    np.testing.assert_allclose(observed.velocities, trial.velocities, atol=1e-5)
    np.testing.assert_array_equal(observed.joints_rad, trial.joints_rad)


@pytest.mark.parametrize("source", SOURCES)
def test_every_source_displaces_the_object_relative_to_the_taxels(trial: TouchTrial, source: str) -> None:
    true, erring = ErringRobot.draw(only(), rng()), ErringRobot.draw(only(source), rng())
    error = end_from_taxels(erring, erring.observe(trial, True, rng(1))) - end_from_taxels(true, trial)
    assert 0.0005 < np.median(np.linalg.norm(error, axis=1)) < 0.1


def test_all_sources_together_are_several_centimetres(trial: TouchTrial) -> None:
    true = end_from_taxels(ErringRobot.draw(only(), rng()), trial)
    robots = [ErringRobot.draw(ErrorSources(), rng(k)) for k in range(8)]
    errors = [np.linalg.norm(end_from_taxels(r, r.observe(trial, True, rng())) - true, axis=1).mean() for r in robots]
    assert 0.01 < np.median(errors) < 0.08


def test_slack_differs_between_trials_and_the_encoder_offsets_do_not(trial: TouchTrial) -> None:
    for sources, same in ((only("joint calibration"), True), (only("backlash, elasticity"), False)):
        robot, generator = ErringRobot.draw(sources, rng()), rng(1)
        first, second = (robot.observe(trial, True, generator).positions for _ in range(2))
        assert np.allclose(first, second) is same


def test_a_felt_fingertip_does_not_depend_on_the_cameras(trial: TouchTrial) -> None:
    observed = ErringRobot.draw(only("cameras"), rng()).observe(trial, False, rng())
    np.testing.assert_allclose(observed.positions, trial.positions, atol=1e-6)


def test_encoder_offsets_estimated_from_touches_halve_the_error() -> None:
    trials = exact_trials("inner", 8, SEED)
    none = dict.fromkeys(vars(ErrorSources()), 0.0)
    robot = ErringRobot.draw(ErrorSources(**{**none, "joint_rad": float(np.deg2rad(4.0))}), rng(1))
    true = ErringRobot.draw(only(), rng())

    def error_mm(of: ErringRobot) -> float:
        errors = [end_from_taxels(of, of.observe(t, True, rng())) - end_from_taxels(true, t) for t in trials]
        return 1000 * float(np.median(np.linalg.norm(errors, axis=2)))

    better = robot.calibrated([robot.observe(trial, True, rng()) for trial in trials])
    assert error_mm(robot) > 20
    assert error_mm(better) < 0.5 * error_mm(robot)


def test_a_robot_without_errors_touches_what_it_aims_at_and_one_with_errors_feels_its_finger_elsewhere() -> None:
    """The first touch is aimed at taxel 27, the first inner one."""
    exact, erring = ErringRobot.draw(only(), rng()), ErringRobot.draw(only("joint calibration"), rng())
    (true,), (misjudged,) = (misaimed_touches(robot, 1, SEED) for robot in (exact, erring))
    gaps = np.linalg.norm(end_from_taxels(exact, true), axis=1) - FINGERTIP_RADIUS_M
    assert gaps.argmin() == SKIN.index("left_forearm:27")
    assert gaps.min() < 0.0075  # a step at 15 cm/s
    assert np.array_equal(gaps <= TOUCH_RADIUS_M, true.touched)
    assert misjudged.touched.any()
    felt = np.linalg.norm(end_from_taxels(erring, misjudged), axis=1) - FINGERTIP_RADIUS_M
    assert not np.array_equal(felt <= TOUCH_RADIUS_M, misjudged.touched)
