"""What a moving skin perceives of a trial: frame by frame as at rest, and by how its distance really changes."""

import numpy as np
import pytest

from learning.pps.receptive_field import ReceptiveField, perceive
from learning.pps.touch_trial import TouchTrial, perceived
from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.skin import icub_skin

ROBOT, SKIN, FIELD = load_icub(), icub_skin(("left_forearm", "right_palm")), ReceptiveField()
ELBOW = ROBOT.indices(("left_elbow",))[0]
T, STEP_S = 21, 0.05


def trial_of(joints, positions, velocities, covs=None, radius=0.035):
    T = len(joints)
    covs = np.zeros((T, 3, 3)) if covs is None else covs
    stamps = STEP_S * np.arange(T)
    touched = np.zeros(len(SKIN.taxel_ids), bool)
    return TouchTrial(stamps, joints, positions, velocities, covs, np.full(T, radius), touched, SKIN.taxel_ids[0])


def bending() -> np.ndarray:
    """A left elbow that bends at 20°/s."""
    joints = np.tile(home(ROBOT), (T, 1))
    joints[:, ELBOW] += np.deg2rad(20) * STEP_S * np.arange(T)
    return joints


@pytest.mark.parametrize("field", [FIELD, ReceptiveField(subtract_radius=True)])
def test_an_arm_at_rest_perceives_each_frame_alone(field):
    rng = np.random.default_rng(3)
    q = home(ROBOT)
    positions, normals = SKIN.at(ROBOT.at(q))
    p = positions[0] + 0.1 * normals[0] + 0.03 * rng.standard_normal((T, 3))
    v = 0.1 * rng.standard_normal((T, 3))
    covs = np.tile(0.01**2 * np.eye(3), (T, 1, 1))
    p[4], v[4] = np.nan, np.nan
    D, ttc = perceived(trial_of(np.tile(q, (T, 1)), p, v, covs), ROBOT, SKIN, field)
    for k in range(T):
        alone = perceive(field, positions, normals, p[k], v[k], 0.035, covs[k])
        np.testing.assert_allclose((D[k], ttc[k]), alone, rtol=1e-9)
    assert np.isnan(D[4]).all()


def test_to_a_moving_arm_what_stands_still_comes_as_fast_as_it_nears():
    joints = bending()
    taxels = np.array([SKIN.at(ROBOT.at(q))[0] for q in joints])
    p = taxels[T // 2, 0] + np.array([-0.05, 0.02, 0.06])
    D, ttc = perceived(trial_of(joints, np.tile(p, (T, 1)), np.zeros((T, 3))), ROBOT, SKIN, FIELD)
    gap = np.linalg.norm(taxels - p, axis=2)
    closing = -np.gradient(gap, STEP_S, axis=0)
    inside = np.isfinite(D) & (np.abs(closing) > 0.01)
    inside[[0, -1]] = False
    assert inside.sum() > 50
    np.testing.assert_allclose(ttc[inside], gap[inside] / closing[inside], rtol=0.02)


def test_what_moves_with_the_arm_does_not_approach():
    joints = bending()
    postures = [ROBOT.at(q) for q in joints]
    point = SKIN.parts[0].positions_m[0] + 0.08 * SKIN.parts[0].normals[0]
    p = np.array([posture.point("left_forearm", point) for posture in postures])
    v = np.array([posture.jacobian("left_forearm", point)[:3, ELBOW] * np.deg2rad(20) for posture in postures])
    D, ttc = perceived(trial_of(joints, p, v), ROBOT, SKIN, FIELD)
    np.testing.assert_allclose(D[:, 0], 0.08)
    assert (np.abs(ttc[1:-1, 0]) > 20).all()


def test_a_trial_of_nothing_known_perceives_nothing():
    nothing = np.full((1, 3), np.nan)
    trial = trial_of(home(ROBOT)[None], nothing, nothing, np.full((1, 3, 3), np.nan), np.nan)
    for series in perceived(trial, ROBOT, SKIN, FIELD):
        assert series.shape == (1, len(SKIN.taxel_ids))
        assert np.isnan(series).all()
