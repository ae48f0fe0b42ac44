"""The learned relation of torso to gaze against the robot's own kinematics, joint by joint."""

import numpy as np
import pytest
from data import SEED

from learning.reach.torso_gaze import TorsoFrame, TorsoToGaze, torso_limits, turn_torso
from pps_vision.robot.gaze import GazeLimits, fixation_point
from pps_vision.robot.icub import load_icub, set_gaze

ROBOT = load_icub()
NEAR = GazeLimits(vergence_rad=(np.deg2rad(8), np.deg2rad(45)))


def posture(gaze, torso):
    q = np.zeros(ROBOT.n_joints)
    q[ROBOT.indices(("torso_yaw", "torso_pitch"))] = torso
    return ROBOT.at(set_gaze(ROBOT, q, gaze[0], gaze[1], 0.0, 0.0, gaze[2]))


def test_points_that_the_torso_carries():
    rng = np.random.default_rng(SEED)
    frame = TorsoFrame(ROBOT)
    for _ in range(5):
        gaze, torso = rng.uniform(NEAR.lower, NEAR.upper), rng.uniform(*torso_limits(ROBOT))
        upright, turned = fixation_point(posture(gaze, [0, 0]))[None], fixation_point(posture(gaze, torso))[None]
        np.testing.assert_allclose(frame.to_root(torso[None], upright), turned, atol=1e-9)
        np.testing.assert_allclose(frame.from_upright(torso[None], turned), upright, atol=1e-9)


def test_the_turned_robot_still_fixates():
    """What the eyes meet after a turn of 2° and the gaze that goes with it is where it was, to a twentieth of what it
    would be off with the gaze kept."""
    rng = np.random.default_rng(SEED)
    relation = TorsoToGaze()
    relation.learn(turn_torso(ROBOT, 250, rng, NEAR))
    off, off_if_kept = [], []
    low, high = torso_limits(ROBOT)
    for _ in range(40):
        gaze, torso = rng.uniform(NEAR.lower, NEAR.upper), rng.uniform(0.9 * low, 0.9 * high)
        turn = np.deg2rad(2) * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])[rng.integers(4)]
        before = fixation_point(posture(gaze, torso))
        after = relation(gaze, torso, turn[None])[0]
        off.append(np.linalg.norm(fixation_point(posture(after, torso + turn)) - before))
        off_if_kept.append(np.linalg.norm(fixation_point(posture(gaze, torso + turn)) - before))
    print(f"off by {1000 * np.median(off):.2f} mm, {1000 * np.median(off_if_kept):.1f} mm with the gaze kept")
    assert np.median(off) < 0.05 * np.median(off_if_kept)


def test_noise_in_the_gaze_is_noise_in_the_samples():
    clean, noisy = (turn_torso(ROBOT, 50, np.random.default_rng(1), NEAR, noise) for noise in (0.0, 0.01))
    assert (noisy.gaze_rad - clean.gaze_rad).std() == pytest.approx(0.01, rel=0.3)
    assert (noisy.after_rad - clean.after_rad).std() == pytest.approx(0.01, rel=0.2)
    np.testing.assert_array_equal(noisy.torso_rad, clean.torso_rad)
