"""Trials in the taxels' frames against geometry."""

from dataclasses import replace

import numpy as np
from data import SEED

from learning.pps.joint_offsets import TouchTrial
from learning.pps.receptive_field import ReceptiveField
from learning.pps.receptive_field import perceive as perceive_at
from pps_vision.experiments.pps.taxel_trials import in_taxel_frames, perceive
from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.skin import icub_skin, touched_taxels

ROBOT = load_icub()
SKIN = icub_skin()
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
