"""Robots that misjudge where they are touched, and what controls that have learned nothing are given."""

from dataclasses import replace

import numpy as np
import pytest

from pps_vision.app.encounters.encounter import draw
from pps_vision.app.encounters.kinematic import simulate_encounter
from pps_vision.app.encounters.registry import CONTROLLERS, GEOMETRY, NONE, ONE, OURS
from pps_vision.app.encounters.robots import ErrorSources, MiscalibratedRobot
from pps_vision.app.encounters.tracks import track_of, true_track_of
from pps_vision.experiments.encounters.learning import encounter_number, summary


@pytest.fixture(scope="module")
def touches(scene):
    return [draw(scene, "press", k, 3) for k in (0, 1, 2)]


@pytest.mark.parametrize("error_m", [0.01, 0.05])
def test_a_robot_misjudges_its_touches_by_the_stated_error(touches, error_m):
    robot = MiscalibratedRobot.with_error(error_m, touches, (3,))
    assert robot.misjudgement_m(touches) == pytest.approx(error_m, rel=0.15)
    other = MiscalibratedRobot.with_error(error_m, touches, (4,))
    assert np.abs(other.joint_offsets_rad - robot.joint_offsets_rad).max() > 1e-3


def test_a_robot_without_error_sees_and_moves_as_the_exact_one(scene, memories):
    robot = MiscalibratedRobot.draw(ErrorSources().scaled(0), np.random.default_rng(0))
    encounter = draw(scene, "through", 0, 3)
    exact = track_of(scene, encounter, np.random.default_rng(1))
    reading = robot.reading(np.random.default_rng(2))
    seen = robot.see(exact, encounter.q_rad, reading)
    for track, again in zip(exact, seen, strict=True):
        np.testing.assert_allclose(again.mean, track.mean, atol=1e-4)
    arguments = scene, memories["left"].of_both, encounter, OURS, CONTROLLERS[OURS].new
    assert simulate_encounter(*arguments, seen, erring=(robot.scene, reading)).distance_m == pytest.approx(
        simulate_encounter(*arguments, exact).distance_m, abs=1e-3
    )


def test_an_erring_robot_moves_its_true_arm_by_what_it_believes(scene, memories, touches):
    """With encoders 10° off it takes its arm to be elsewhere; what touches is where the arm truly is."""
    robot = MiscalibratedRobot.draw(ErrorSources().scaled(0), np.random.default_rng(0))
    robot = replace(robot, joint_offsets_rad=np.full(robot.model.n_joints, np.deg2rad(10.0)))
    reading = robot.joint_offsets_rad
    seen = robot.see(true_track_of(touches[0]), touches[0].q_rad, reading)
    arguments = scene, memories["left"].of_both, touches[0], ONE, CONTROLLERS[NONE].new, seen
    assert simulate_encounter(*arguments, erring=(robot.scene, reading)).touched


def test_geometry_alone_leaves_what_passes_beyond_its_margin(scene, memories):
    """Without a gate the constant responds to an object that passes at 5 to 10 cm; geometry does not."""
    encounter = draw(scene, "harmless_near", 0, 3)
    tracks = true_track_of(encounter)
    commands = {
        name: simulate_encounter(
            scene, CONTROLLERS[name].memory_of(memories["left"]), encounter, name, CONTROLLERS[name].new, tracks
        ).commands
        for name in (ONE, GEOMETRY)
    }
    assert commands[ONE] > 0
    assert commands[GEOMETRY] == 0


def test_each_robot_has_encounters_of_its_own_arm_and_all_parts():
    numbers = [encounter_number(robot, k, 4) for robot in range(6) for k in range(4)]
    assert len(set(numbers)) == 24
    sides = np.array([number // 3 % 2 for number in numbers]).reshape(6, 4)
    np.testing.assert_array_equal(sides, np.tile(np.arange(6)[:, None] % 2, (1, 4)))
    assert {number % 3 for number in numbers[:4]} == {0, 1, 2}


def test_the_scores_of_a_robot_are_the_means_of_its_hazards_and_harmless_objects():
    rows = [
        {"controller": name, "robot": robot, "error_m": 0.03, "condition": condition, "touched": touched, "commands": n}
        for robot in (0, 1)
        for name, outcomes in {
            OURS: (("press", False, 5), ("through", robot == 1, 5), ("harmless_near", False, 0)),
            ONE: (("press", False, 5), ("through", True, 5), ("harmless_near", False, 3)),
        }.items()
        for condition, touched, n in outcomes
    ]
    cells = summary(rows)["by_error_cm"]["3"]
    assert cells[OURS]["untouched"][0] == pytest.approx(75)
    assert cells[OURS]["still"][0] == 100
    assert cells[ONE]["ours above"][0] == pytest.approx((100 - 25 + 75 - 25) / 2)
