"""Movements of R's sessions against geometry: exact, rendered, by miscalibrated robots, and in the taxels' frames."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED

from learning.pps.joint_offsets import TouchTrial
from learning.pps.receptive_field import ReceptiveField
from learning.pps.receptive_field import perceive as perceive_at
from pps_vision.app.encounters.robots import MiscalibratedRobot, errors_from
from pps_vision.app.sessions import AIMED, movements
from pps_vision.experiments.pps.session_trials import exact_trials, rendered_trials
from pps_vision.experiments.pps.taxel_trials import in_taxel_frames, perceive
from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.skin import TOUCH_RADIUS_M, icub_skin, touched_taxels

ROBOT = load_icub()
SKIN = icub_skin()


def rng(k: int = 0) -> np.random.Generator:
    return np.random.default_rng((SEED, k))


@pytest.mark.parametrize("name", ["motor", "inner", "outer", "palm"])
def test_a_trial_ends_in_its_touch(name):
    part, _ = AIMED[name]
    on_part = np.array([taxel.startswith(part) for taxel in SKIN.taxel_ids])
    for trial in exact_trials(name, 2, SEED):
        taxels = np.array([SKIN.at(ROBOT.at(q))[0] for q in trial.joints_rad])
        gaps = np.linalg.norm(taxels - trial.positions[:, None], axis=2) - trial.radius_m[:, None]
        np.testing.assert_array_equal(gaps[-1] <= TOUCH_RADIUS_M, trial.touched)
        assert trial.touched[on_part].any()
        assert gaps.min() > -0.006  # no object penetrates the skin
        assert gaps[0, on_part].min() > 0.10  # it starts beyond most of the receptive field
        mean = 0.5 * (trial.velocities[1:] + trial.velocities[:-1])
        np.testing.assert_allclose(np.diff(trial.positions, axis=0), 0.05 * mean, atol=4e-4)
        if name == "motor":
            tips = [ROBOT.at(q).point("right_index_tip") for q in trial.joints_rad]
            np.testing.assert_allclose(trial.positions, tips, atol=1e-12)


@pytest.mark.long
def test_a_rendered_trial_is_tracked():
    (movement,) = movements("inner", 1, SEED)
    (trial,) = rendered_trials("inner", 1, SEED)
    errors = np.linalg.norm(trial.positions - movement.trial.positions, axis=1)
    assert np.isfinite(errors[-20:]).mean() > 0.8
    assert np.nanmax(errors[-20:]) < 0.04


@pytest.mark.parametrize("by_eyes", [True, False])
def test_without_errors_the_measurement_is_the_truth(by_eyes):
    (trial,) = exact_trials("motor", 1, SEED)
    for source in (errors_from(), errors_from("cameras")):
        measured = MiscalibratedRobot.draw(source, rng()).observe(trial, by_eyes, rng())
        if not by_eyes or source == errors_from():  # a felt fingertip does not depend on the cameras
            np.testing.assert_allclose(measured.positions, trial.positions, atol=1e-6)
            np.testing.assert_allclose(measured.velocities, trial.velocities, atol=1e-5)


POSITIONS, NORMALS = SKIN.at(ROBOT.at(home(ROBOT)))


def straight(taxel: int, aside_m: float, rng: np.random.Generator) -> TouchTrial:
    """A ball approaches along a taxel's normal, displaced to one side."""
    left_s = np.arange(30, -1, -1) * 0.05
    across = np.cross(NORMALS[taxel], rng.standard_normal(3))
    end = POSITIONS[taxel] + 0.03 * NORMALS[taxel] + aside_m * across / np.linalg.norm(across)
    velocity = -rng.uniform(0.06, 0.14) * NORMALS[taxel]
    return TouchTrial(
        stamps_s=1.5 - left_s,
        joints_rad=np.tile(home(ROBOT), (31, 1)),
        positions=end - left_s[:, None] * velocity,
        velocities=np.tile(velocity, (31, 1)),
        velocity_covs=np.zeros((31, 3, 3)),
        radius_m=np.full(31, 0.03),
        touched=touched_taxels(POSITIONS, end, 0.03),
    )


def test_skin_at_rest_perceives_every_frame_alone():
    rng = np.random.default_rng(SEED)
    covs = np.tile(np.diag([0.03, 0.02, 0.01]) ** 2, (31, 1, 1))
    true = replace(straight(3, 0.01, rng), velocities=0.1 * rng.standard_normal((31, 3)), velocity_covs=covs)
    (trial,) = in_taxel_frames([true])
    skin = (POSITIONS[:12], NORMALS[:12])
    alone = perceive_at(ReceptiveField(), *skin, true.positions, true.velocities, 0.03, true.velocity_covs)
    np.testing.assert_allclose(perceive(trial), alone, rtol=1e-6)
    np.testing.assert_array_equal(trial.touched, true.touched[:12])


def test_a_moving_arm_perceives_its_own_approach_to_a_resting_object():
    """A left elbow bends at 20°/s: TTC is the distance over its rate of change."""
    joints = np.tile(home(ROBOT), (21, 1))
    joints[:, ROBOT.indices(("left_elbow",))[0]] += np.deg2rad(20) * 0.05 * np.arange(21)
    taxels = np.array([SKIN.at(ROBOT.at(q))[0] for q in joints])[:, :12]
    p = np.tile(taxels[10, 0] + np.array([-0.05, 0.02, 0.06]), (21, 1))
    still = np.zeros((21, 3))
    stamps = 0.05 * np.arange(21)
    ball = TouchTrial(stamps, joints, p, still, np.zeros((21, 3, 3)), np.zeros(21), np.zeros(32, bool))
    D, ttc = perceive(in_taxel_frames([ball])[0])
    gap = np.linalg.norm(taxels - p[:, None], axis=2)
    closing = -np.gradient(gap, 0.05, axis=0)
    inside = np.isfinite(D) & (np.abs(closing) > 0.01)
    inside[[0, -1]] = False
    assert inside.sum() > 50
    np.testing.assert_allclose(ttc[inside], gap[inside] / closing[inside], rtol=0.02)
