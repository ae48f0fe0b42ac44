"""Fixation in the kinematic loop (20 Hz): the true point is projected, the joints are integrated; gazes of joints."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from eyes import fixation_point

from control.fixation import FixationParams, features, fixation_error, gaze_at, step
from control.head import gaze_columns, gaze_of
from pps_vision.robot.icub import home, icub_rig, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array

DEG = np.pi / 180
DT = 0.05
PARAMS = FixationParams()
NECK = ("neck_yaw", "neck_pitch")
EYES = ("eyes_tilt", "left_eye_pan", "right_eye_pan")


def random_gaze(robot: Robot, rng: np.random.Generator) -> Array:
    """Anywhere in the gaze range, the tilt carrying on where the neck's pitch ends."""
    yaw, up, vergence = rng.uniform([-55, -75, 5], [55, 30, 90]) * DEG
    pitch = max(up, -40 * DEG)
    return set_gaze(robot, home(robot), yaw, pitch, up - pitch, 0.0, vergence)


def move(robot: Robot, q: Array, dq: Array) -> Array:
    """One control period; checks the head's limits."""
    neck = robot.indices(NECK)
    eyes = robot.indices(EYES)
    assert np.abs(dq[neck]).max() <= 60 * DEG + 1e-6
    assert np.abs(dq[eyes]).max() <= 180 * DEG + 1e-6
    others = np.setdiff1d(np.arange(robot.n_joints), neck + eyes)
    assert not np.any(dq[others])
    q = q + DT * dq
    assert np.all((q >= robot.lower_rad - 1e-8) & (q <= robot.upper_rad + 1e-8))
    return q


def test_features_are_js_pixels_near_the_axis(robot, rng):
    """[u_L − u_R, mean u, mean v], undistorted, from the principal point, in focal lengths."""
    q = set_gaze(robot, home(robot), vergence=10 * DEG)
    view = icub_rig(robot).view(q)
    for p in fixation_point(robot.at(q)) + rng.uniform(-0.02, 0.02, (20, 3)):
        left, right = (
            cv2.undistortPoints(v.project(p).reshape(1, 1, 2), v.camera.K, np.array(v.camera.distortion))[0, 0]
            for v in (view.left, view.right)
        )
        expected = [left[0] - right[0], *(0.5 * (left + right))]
        np.testing.assert_allclose(features(robot.at(q), p)[0], expected, atol=1e-4)


def test_the_interaction_matrix_is_the_published_one(robot):
    """At 0.4 m and f = 220: −220 (disparity by vergence), +248 (u by yaw), +249 (v by pitch) px/rad."""
    q = set_gaze(robot, np.zeros(robot.n_joints), vergence=2 * np.arctan(0.034 / 0.4))
    p = fixation_point(robot.at(q))
    slopes = 220 * features(robot.at(q), p)[1] @ gaze_columns(robot)
    yaw, pitch, _, vergence = slopes.T
    np.testing.assert_allclose([vergence[0], yaw[1], pitch[2]], [-220, 248, 249], rtol=0.02)
    # all else is zero by symmetry, but for pitch, which changes the distance and so the disparity
    np.testing.assert_allclose([yaw[0], yaw[2], pitch[1], vergence[1], vergence[2]], 0.0, atol=1e-9)


def test_the_error_decreases_by_eight_times_itself_per_second(robot):
    """In steps of 50 ms to 60 % of itself, where no limit holds."""
    q = gaze_at(robot, home(robot), (-0.4, 0.05, 0.3))
    p = np.array([-0.4, 0.053, 0.302])
    x_initial = features(robot.at(q), p)[0]
    after = features(robot.at(q + DT * step(PARAMS, robot.at(q), p, hold_s=DT).dq_rad_s), p)[0]
    np.testing.assert_allclose(after, 0.6 * x_initial, atol=1e-4)
    assert np.abs(x_initial).max() > 3e-3


def test_the_tilt_returns_to_zero_at_twice_itself_per_second_while_the_point_stays_fixated(robot):
    q = gaze_at(robot, set_gaze(robot, home(robot), tilt=0.0), (-0.4, 0.0, 0.3))
    q = set_gaze(robot, q, pitch=gaze_of(robot.at(q))[1] - 4 * DEG, tilt=4 * DEG)
    p = fixation_point(robot.at(q))
    command = step(PARAMS, robot.at(q), p, hold_s=DT)
    assert command.dq_rad_s[robot.indices(("eyes_tilt",))[0]] == pytest.approx(-8 * DEG, rel=0.02)
    assert command.hold_s == DT
    assert fixation_error(robot.at(q + DT * command.dq_rad_s), p) < 0.01 * DEG


def test_a_static_point_in_view_is_fixated_in_time_from_anywhere(robot, rng):
    rig = icub_rig(robot)
    checked = 0
    while checked < 25:
        p = fixation_point(robot.at(random_gaze(robot, rng)))
        q = random_gaze(robot, rng)
        view = rig.view(q)
        if not (view.left.sees(p) and view.right.sees(p)):
            continue
        errors = []
        for _ in range(40):
            errors.append(fixation_error(robot.at(q), p))
            q = move(robot, q, step(PARAMS, robot.at(q), p, hold_s=DT).dq_rad_s)
        within = np.array(errors) < 0.5 * DEG
        assert np.all(within[30:]), "not within 0.5° from 1.5 s on"
        checked += 1


def paths(rng: np.random.Generator) -> list[Callable[[float], Array]]:
    """A straight line and a circle of 10 cm, both at 15 cm/s about 0.4 m from the eyes."""
    center = np.array([-0.07, 0.0, 0.34]) + 0.4 * np.array([-1, rng.uniform(-0.6, 0.6), rng.uniform(-1.2, 0.2)]) / 1.3
    heading, sideways = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
    return [
        lambda t: center + 0.15 * (t - 1) * heading,
        lambda t: center + 0.1 * (heading * np.cos(1.5 * t) + sideways * np.sin(1.5 * t)),
    ]


def test_a_moving_point_is_held_although_it_is_seen_one_frame_late(robot, rng):
    worst = 0.0
    for path in [path for _ in range(6) for path in paths(rng)]:
        q = gaze_at(robot, home(robot), path(0.0))
        for k in range(40):
            t = k * DT
            observed = path(t - DT)
            v = (path(t - DT + 1e-4) - path(t - DT - 1e-4)) / 2e-4
            dq = step(PARAMS, robot.at(q), observed + DT * v, v, hold_s=DT).dq_rad_s
            q_next = move(robot, q, dq)
            for part in (0.5, 1.0):
                worst = max(worst, fixation_error(robot.at(q + part * (q_next - q)), path(t + part * DT)))
            q = q_next
    assert worst < 2 * DEG


@pytest.mark.parametrize("frame", ["left_palm", "left_forearm"])
def test_the_arm_at_home_is_fixated_with_the_eyes_tilt(robot, frame):
    """Beyond the neck's −40° (−51° for the hand, further for the forearm)."""
    p = robot.at(home(robot)).point(frame)
    q = gaze_at(robot, home(robot), p)
    _, pitch, tilt, _ = gaze_of(robot.at(q))
    assert fixation_error(robot.at(q), p) < 0.1 * DEG
    assert pitch == pytest.approx(-40 * DEG, abs=0.1 * DEG)
    assert tilt < -5 * DEG
    assert features(robot.at(q), p)[0][2] == pytest.approx(0.05**2 * -tilt, rel=0.05), "its return"


@pytest.mark.parametrize("p", [(0.5, 0.3, 0.3), (-0.1, 0.0, -0.6), (-0.075, 0.0, 0.34), (-3.0, 0.0, 0.3)])
def test_what_cannot_be_fixated_leaves_the_head_within_its_limits(robot, p):
    """Behind the head, straight below, between the eyes, far away; a gaze outside its range is led back."""
    q = set_gaze(robot, home(robot), vergence=0.0)
    for _ in range(60):
        q = move(robot, q, step(PARAMS, robot.at(q), p, hold_s=DT).dq_rad_s)
    assert gaze_of(robot.at(q))[3] >= 5 * DEG - 1e-6


def test_fixation_error_is_the_worse_eyes_angle(robot):
    q = set_gaze(robot, np.zeros(robot.n_joints), vergence=20 * DEG)
    p = fixation_point(robot.at(q))
    for changes, error_deg in (({}, 0), ({"version": 3 * DEG}, 3), ({"vergence": 30 * DEG}, 5)):
        assert fixation_error(robot.at(set_gaze(robot, q, **changes)), p) == pytest.approx(error_deg * DEG, abs=1e-7)


def test_a_joint_may_reach_its_limit_in_one_step(robot):
    q = set_gaze(robot, home(robot), pitch=-39 * DEG, vergence=10 * DEG)
    q = move(robot, q, step(PARAMS, robot.at(q), (-0.2, 0.0, -0.2), hold_s=DT).dq_rad_s)
    posture = robot.at(q)
    assert gaze_of(posture)[1] == pytest.approx(-40 * DEG, abs=1e-6)
    # a point straight above an eye, whose azimuth is undefined, has finite derivatives
    x, dx_dq, dx_dp = features(posture, posture.point("left_eye", (0.0, -0.3, 0.0)))
    assert np.isfinite(x).all()
    assert max(np.abs(dx_dq).max(), np.abs(dx_dp).max()) < 1e7


def test_a_target_that_is_not_finite_is_refused(robot):
    for p, v in (((np.nan, 0, 0), (0, 0, 0)), ((-0.3, 0, 0), (0, np.inf, 0)), ((-0.3, 0), (0, 0, 0))):
        with pytest.raises(ValueError, match="expected a known point and velocity"):
            step(PARAMS, robot.at(home(robot)), p, v)
