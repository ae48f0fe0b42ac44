"""Fixation points and the gaze postures that reach them."""

import numpy as np
import pytest

from pps_vision.robot.gaze import GazeLimits, fixation_point, fixation_points, gaze_for_points
from pps_vision.robot.icub import load_icub, set_gaze

ROBOT = load_icub()
ZERO = np.zeros(ROBOT.n_joints)


def random_gaze(n, limits=None):
    limits = limits or GazeLimits()
    return np.random.default_rng(0).uniform(limits.lower, limits.upper, (n, 3))


def test_the_check_of_the_kinematic_tables():
    np.testing.assert_allclose(fixation_points(ROBOT, [[0, 0, np.deg2rad(20)]]), [[-0.2556, 0, 0.3408]], atol=1e-4)


def test_batch_and_posture_agree_and_both_eyes_look_there():
    gaze = random_gaze(30)
    points = fixation_points(ROBOT, gaze)
    for (yaw, pitch, vergence), point in zip(gaze, points, strict=True):
        posture = ROBOT.at(set_gaze(ROBOT, ZERO, yaw=yaw, pitch=pitch, vergence=vergence))
        np.testing.assert_allclose(fixation_point(posture), point, atol=1e-9)
        for eye in ("left_eye", "right_eye"):
            x, y, z = np.linalg.inv(posture.T_root(eye))[:3] @ [*point, 1]
            assert np.hypot(x, y) < 1e-9
            assert z > 0


def test_any_posture_even_where_the_eyes_do_not_quite_meet():
    """With the left eye turned about its own axis of sight's normal the rays are skew: the midpoint is
    as far from one ray as from the other, and no point is nearer to both."""
    posture = ROBOT.at(set_gaze(ROBOT, ZERO + 0.1, version=0.2, vergence=0.3))
    point = fixation_point(posture)
    away = []
    for eye in ("left_eye", "right_eye"):
        T = posture.T_root(eye)
        away.append(np.linalg.norm(np.cross(point - T[:3, 3], T[:3, 2])))
    assert away[0] == pytest.approx(away[1], abs=1e-12)


@pytest.mark.parametrize("vergence_deg", [0.0, -10.0])
def test_eyes_that_do_not_converge_fixate_nothing(vergence_deg):
    vergence = np.deg2rad(vergence_deg)
    assert fixation_point(ROBOT.at(set_gaze(ROBOT, ZERO, vergence=vergence))) is None
    assert np.isnan(fixation_points(ROBOT, [[0, 0, vergence]])).all()


def test_there_and_back():
    gaze = random_gaze(500)
    np.testing.assert_allclose(gaze_for_points(ROBOT, fixation_points(ROBOT, gaze)), gaze, atol=1e-5)


def test_beyond_the_limits_is_nan_and_wider_limits_help():
    points = [[-0.30, -0.20, 0.05], [0.3, 0, 0.3], [np.nan, 0, 0], [-3.0, 0, 0.3]]  # low, behind, unknown, far
    assert np.isnan(gaze_for_points(ROBOT, points)).all()
    wide = GazeLimits(pitch_rad=(np.deg2rad(-80), np.deg2rad(40)))
    gaze = gaze_for_points(ROBOT, points, wide)
    assert np.rad2deg(gaze[0, 1]) == pytest.approx(-51, abs=1)  # FACTS §5: the home hand
    np.testing.assert_allclose(fixation_points(ROBOT, gaze[:1])[0], points[0], atol=1e-6)
    assert np.isnan(gaze[1:]).all()


def test_limits_out_of_order_are_refused():
    with pytest.raises(ValueError, match="lower below upper"):
        GazeLimits(yaw_rad=(1.0, -1.0))
