"""Poses that images correct: the delay of joints by grids and normal equations, a turning rig by its homography."""

import math

import cv2
import numpy as np
import pytest
from far_wall import CAMERA, seen

from pps_vision.geometry.camera import StereoRig
from pps_vision.geometry.se3 import transform
from pps_vision.types import Array, StereoFrame
from tracking.camera_pose import PoseEstimator, exact_or_late

PRIOR_S = 0.02


@pytest.mark.parametrize("measured_s", [0.0, 0.001, 0.004, 0.010, -0.020])
@pytest.mark.parametrize("noise_s", [0.0005, 0.002, 0.01])
def test_mean_and_spread_are_those_of_the_posterior(measured_s, noise_s):
    tau = np.linspace(-0.15, 0.15, 30001)
    step = tau[1] - tau[0]
    prior = np.exp(-0.5 * (tau / PRIOR_S) ** 2) / (np.sqrt(2 * np.pi) * PRIOR_S) * step
    prior[len(tau) // 2] += 1.0  # exact joints are as likely as late ones
    posterior = prior * np.exp(-0.5 * ((measured_s - tau) / noise_s) ** 2)
    posterior /= posterior.sum()
    mean = posterior @ tau
    std = np.sqrt(posterior @ (tau - mean) ** 2)
    var = 1 / (noise_s**-2 + PRIOR_S**-2)  # of late joints alone
    estimate = exact_or_late(measured_s * var / noise_s**2, var, PRIOR_S)
    assert estimate == pytest.approx((mean, std), rel=2e-3, abs=2e-6)


def posed(angle: float) -> tuple[Array, Array]:
    """Two eyes 6 cm apart that turn together about a vertical axis between them."""
    R = cv2.Rodrigues(np.array([0.0, angle, 0.0]))[0]
    return transform(R, R @ [-0.03, 0.0, 0.0]), transform(R, R @ [0.03, 0.0, 0.0])


TURNING = StereoRig(CAMERA, CAMERA, lambda q: posed(0.0 if q is None else float(q[0])))
NO_IMAGE = np.zeros((240, 320, 3), np.uint8)


def test_poses_that_no_image_corrects_are_those_that_are_told():
    q = np.array([0.1])
    frame = StereoFrame(NO_IMAGE, NO_IMAGE, 0.0, 0.0, q, q)
    for poses in (PoseEstimator(TURNING, 0.0), PoseEstimator(TURNING, PRIOR_S)):
        for estimate in (poses.nominal(frame), poses.step(frame)):
            assert estimate.is_known
            assert np.array_equal(estimate.view.left.T_root_camera, posed(0.1)[0])
            assert np.array_equal(estimate.view.right.T_root_camera, posed(0.1)[1])
    motion = PoseEstimator(TURNING, 0.0).motion  # joints that are never late have no delay
    assert (motion.delay_s, motion.rate_rad_s) == (0.0, 0.0)
    assert math.isnan(motion.delay_std_s)


def pair(turn_left: Array, turn_right: Array, t: float, rng: np.random.Generator) -> StereoFrame:
    return StereoFrame(seen(turn_left, rng), seen(turn_right, rng), t, t)


FIXED = StereoRig.fixed(CAMERA, CAMERA, transform(translation=(0.06, 0.0, 0.0)))


def test_a_rig_said_to_be_fixed_turns_as_its_images_say(rng):
    """0.5° from one frame to the next; both eyes turn about the middle between them."""
    poses = PoseEstimator(FIXED, 0.0)
    for k in range(6):
        turn = np.deg2rad([0.0, 0.5 * k, 0.1 * k])
        estimate = poses.step(pair(turn, turn, 0.1 * k, rng))
        R = cv2.Rodrigues(turn)[0]
        for eye, x in ((estimate.view.left, -0.03), (estimate.view.right, 0.03)):
            np.testing.assert_allclose(eye.T_root_camera[:3, :3], R, atol=0.1 / 280)
            np.testing.assert_allclose(eye.center, R @ [x, 0.0, 0.0] + [0.03, 0.0, 0.0], atol=1e-4)
        assert estimate.is_known
        assert estimate.stamp_error_s == 0
    motion = poses.motion
    np.testing.assert_allclose(motion.rotation_rad, turn, atol=0.1 / 280)
    step = np.linalg.norm(np.deg2rad([0.0, 0.5, 0.1]))
    # the mean of the last second weighs each frame with a tenth: 1 - 0.9⁵ of the rate after five of them
    assert motion.rate_rad_s == pytest.approx(step / 0.1 * (1 - 0.9**5), rel=0.05)
    assert estimate.rotation_std_rad == pytest.approx(np.sqrt(step**2 / 6), rel=0.05)
    assert math.isnan(motion.delay_std_s)


def test_a_rig_that_rests_stays_where_it_is_told_to_be(rng):
    poses = PoseEstimator(FIXED, 0.0)
    for k in range(4):
        estimate = poses.step(pair(np.zeros(3), np.zeros(3), 0.1 * k, rng))
        assert np.array_equal(estimate.view.left.T_root_camera, np.eye(4))
    assert not poses.motion.rotation_rad.any()
    assert poses.motion.rate_rad_s == 0


def test_the_first_image_of_a_shaking_rig_is_not_at_the_told_pose(rng):
    """0.3° about each axis: the stated standard deviation is that of the shaking, and covers the error."""
    poses = PoseEstimator(FIXED, 0.0)
    for k in range(40):
        turn = np.deg2rad(rng.normal(0, 0.3, 3))
        estimate = poses.step(pair(turn, turn, k / 30, rng))
    R_error = cv2.Rodrigues(turn)[0].T @ estimate.view.left.T_root_camera[:3, :3]
    assert np.linalg.norm(cv2.Rodrigues(R_error)[0]) < 3.4 * estimate.rotation_std_rad  # 99 % quantile of three axes
    assert estimate.rotation_std_rad == pytest.approx(np.deg2rad(0.3), rel=0.25)


def test_eyes_that_turn_apart_tell_no_rotation_of_the_rig(rng):
    """By 0.4° about the vertical, 2 px; then a new scene, which is the reference half a second later."""
    poses = PoseEstimator(FIXED, 0.0)
    still = np.zeros(3)
    apart = np.deg2rad([0.0, 0.4, 0.0])
    poses.step(pair(still, still, 0.0, rng))
    assert [poses.step(pair(apart, -apart, t, rng)).is_known for t in (0.1, 0.2)] == [False, False]
    assert poses.step(pair(still, still, 0.3, rng)).is_known
    scene = [np.ascontiguousarray(seen(still, rng)[::-1, ::-1]) for _ in range(2)]
    is_known = [poses.step(StereoFrame(*scene, t, t)).is_known for t in (0.4, 0.7, 0.85, 0.9)]
    assert is_known == [False, False, False, True]


@pytest.mark.parametrize("late_s", [0.0, 0.025])
def test_the_delay_of_a_swaying_heads_joints_is_found(late_s, rng):
    """8° to each side every 1.6 s; the joints are told as late as that, to 2 ms and within their own uncertainty."""
    poses = PoseEstimator(TURNING, PRIOR_S)
    off_rad = []

    def angle(t: float) -> float:
        return float(np.deg2rad(8) * np.sin(2 * np.pi * t / 1.6))

    for k in range(60):
        t = 0.04 * k
        image = seen(np.array([0.0, angle(t), 0.0]), rng)
        q = np.array([angle(t - late_s)])
        estimate = poses.step(StereoFrame(image, image, t, t, q, q))
        off_rad.append(cv2.Rodrigues(estimate.view.left.T_root_camera[:3, :3])[0][1, 0] - angle(t))
    motion = poses.motion
    assert abs(motion.delay_s - late_s) < 0.002
    assert abs(motion.delay_s - late_s) < 4 * motion.delay_std_s + 1e-4
    assert estimate.stamp_error_s == motion.delay_std_s
    assert np.abs(off_rad[-20:]).max() < 1.0 / 280  # a pixel; 25 ms too early or late is 4 of them
