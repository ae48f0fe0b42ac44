"""Poses that images correct: the delay of joints by grids and normal equations, rotations of a camera and of a rig
before a photograph-like wall that is drawn by a homography, whose rotation is the truth.
"""

import math
from collections.abc import Iterator
from copy import deepcopy
from functools import cache

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, StereoRig, View
from pps_vision.geometry.se3 import transform
from pps_vision.types import Array, Image, StereoFrame
from tracking.camera_pose import PoseEstimator, Reference, exact_or_late

PRIOR_S = 0.02
CAMERA = Camera(320, 240, 280.0, 280.0, 159.5, 119.5)
PX = 1 / CAMERA.fx


@cache
def far_wall() -> Image:
    """(480, 640, 3) blobs of all sizes."""
    rng = np.random.default_rng(1)
    layers = [
        cv2.resize(rng.normal(0, 30, (480 // k, 640 // k, 1)), (640, 480), interpolation=cv2.INTER_CUBIC)
        for k in (6, 12, 24, 60)
    ]
    return np.clip(128 + np.sum(layers, axis=0)[..., None] + np.zeros(3), 0, 255).astype(np.uint8)


def seen(
    rotation: Array, rng: np.random.Generator, noise: float = 2.0, camera: Camera = CAMERA, wall: Image | None = None
) -> Image:
    """The wall from a camera turned by a rotation vector (T_root_camera), with pixel noise."""
    R = cv2.Rodrigues(np.asarray(rotation, float))[0]
    H = np.array([[1.0, 0, 160], [0, 1, 120], [0, 0, 1]]) @ CAMERA.K @ R @ np.linalg.inv(camera.K)
    size = camera.width, camera.height
    source = far_wall() if wall is None else wall
    image = cv2.warpPerspective(source, H, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP).astype(float)
    return np.clip(np.rint(image + noise * rng.standard_normal(image.shape)), 0, 255).astype(np.uint8)


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


def test_a_rig_turns_as_one_eye_says_where_the_other_sees_nothing(rng):
    poses = PoseEstimator(FIXED, 0.0)
    turn = np.deg2rad([0.1, 0.4, 0.0])
    poses.step(pair(np.zeros(3), np.zeros(3), 0.0, rng))
    images = [seen(turn, rng), np.full((240, 320, 3), 128, np.uint8)]
    for k, (left, right) in enumerate((images, images[::-1])):
        estimate = poses.step(StereoFrame(left, right, 0.1 + 0.1 * k, 0.1 + 0.1 * k))
        assert estimate.is_known
        np.testing.assert_allclose(estimate.view.left.T_root_camera[:3, :3], cv2.Rodrigues(turn)[0], atol=0.1 * PX)


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


def swaying(
    n: int, rng: np.random.Generator, late_s: float = 0.0, deg: float = 8.0, jitter_deg: float = 0.0
) -> Iterator[tuple[StereoFrame, float]]:
    """Frames of a head that turns by `deg` to each side every 1.6 s, and its angle; its joints are reported late."""
    for t in 0.04 * np.arange(n):
        angle, reported = np.deg2rad(deg) * np.sin(2 * np.pi * np.array([t, t - late_s]) / 1.6)
        jitter = np.deg2rad(jitter_deg) * rng.standard_normal(3)
        image = seen(jitter + np.array([0.0, angle, 0.0]), rng)
        yield StereoFrame(image, image, float(t), float(t), np.array([reported]), np.array([reported])), float(angle)


@pytest.mark.parametrize("late_s", [0.0, 0.025])
def test_the_delay_of_a_swaying_heads_joints_is_found(late_s, rng):
    """The joints are reported as late as that, to 0.5 ms and within their own uncertainty."""
    poses = PoseEstimator(TURNING, PRIOR_S)
    off_rad = []
    for frame, angle in swaying(60, rng, late_s):
        estimate = poses.step(frame)
        off_rad.append(cv2.Rodrigues(estimate.view.left.T_root_camera[:3, :3])[0][1, 0] - angle)
    motion = poses.motion
    assert abs(motion.delay_s - late_s) < 0.0005
    assert abs(motion.delay_s - late_s) < 4 * motion.delay_std_s + 1e-4
    assert estimate.stamp_error_s == motion.delay_std_s < 0.0005
    assert np.abs(off_rad[-20:]).max() < 1.0 / 280  # a pixel; 25 ms too early or late is 4 of them
    for gap_s, is_as_told in ((0.24, False), (0.3, True)):  # after which the rate of the joints is not known
        t = frame.stamp_s + gap_s
        q = 1.01 * frame.joints_left_rad
        later = deepcopy(poses).step(StereoFrame(frame.left, frame.right, t, t, q, q))
        assert np.array_equal(later.view.left.T_root_camera, posed(q.item())[0]) == is_as_told


def test_a_head_that_has_hardly_turned_leaves_its_joints_delay_uncertain(rng):
    """1° to each side, for half a second: a delay of 25 ms is known to 4 ms, and within 3 deviations."""
    poses = PoseEstimator(TURNING, PRIOR_S)
    for frame, _ in swaying(14, rng, 0.025, 1.0):
        poses.step(frame)
    motion = poses.motion
    assert abs(motion.delay_s - 0.025) < 3 * motion.delay_std_s
    assert 0.001 < motion.delay_std_s < 0.01


def test_the_jitter_of_a_swaying_head_is_stated(rng):
    """0.2° about each axis from image to image, which no delay explains."""
    poses = PoseEstimator(TURNING, PRIOR_S)
    stated = [poses.step(frame).rotation_std_rad for frame, _ in swaying(100, rng, jitter_deg=0.2)]
    assert np.mean(stated[50:]) == pytest.approx(np.deg2rad(0.2), rel=0.15)


STILL = View(CAMERA, np.eye(4))
NO_TURN = np.zeros(3)


@pytest.fixture
def reference(rng: np.random.Generator) -> Reference:
    return Reference(CAMERA, seen(NO_TURN, rng), np.eye(4))


def covered(image: Image, share: float) -> Image:
    """A plain board with a bright edge over the left part of the image."""
    out = image.copy()
    x = round(share * image.shape[1])
    out[:, :x] = (90, 60, 30)
    out[:, max(x - 2, 0) : x] = 255
    return out


def brighter(image: Image, gain: float) -> Image:
    return np.clip(gain * image.astype(float), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("degrees", "change", "off_px"),
    [
        ((0.0, 1.0, 0.0), None, 0.02),
        ((0.3, -0.6, 0.5), None, 0.02),
        ((-1.5, 2.0, 1.0), None, 0.02),
        ((0.05, 0.0, -0.05), None, 0.02),
        ((0.0, 0.5, 0.0), lambda image: covered(image, 0.3), 0.03),
        # Lucas–Kanade alone takes the change of light for motion, of six times as much as is allowed here
        ((0.3, -0.6, 0.5), lambda image: brighter(image, 0.9), 0.03),
        ((0.3, -0.6, 0.5), lambda image: brighter(image, 1.1), 0.03),
    ],
)
def test_a_rotation_is_measured_to_a_fiftieth_of_a_pixel(degrees, change, off_px, reference, rng):
    """A thirtieth where a third of the image is covered, or under another light."""
    turn = np.deg2rad(degrees)
    image = seen(turn, rng)
    image = image if change is None else change(image)
    error = reference.misalignment(image, STILL, 1.2, NO_TURN).rotation - turn
    assert np.abs(error[:2]).max() < off_px * PX
    assert abs(error[2]) < 2 * off_px * PX
    assert not reference.is_still(image)


def test_an_eye_that_rests_is_still_through_noise_and_a_change_of_light(reference, rng):
    for _ in range(5):
        assert reference.is_still(seen(NO_TURN, rng, noise=4.0))
        assert reference.is_still(brighter(seen(NO_TURN, rng), 0.9))


@pytest.mark.parametrize(("shift_px", "still"), [(0.07, True), (0.14, False)])
def test_an_eye_is_still_where_corners_move_by_less_than_a_tenth_of_a_pixel(shift_px, still, rng):
    reference = Reference(CAMERA, seen(NO_TURN, rng, noise=0.5), np.eye(4))
    for way in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)):
        assert reference.is_still(seen(shift_px * PX * np.array(way), rng, noise=0.5)) == still


def test_a_rotation_is_measured_by_an_eye_that_has_come_nearer(reference, rng):
    """To a wall 1.2 m away by 3 cm, which enlarges it."""
    turn = np.deg2rad([0.3, -0.6, 0.5])
    nearer = Camera(320, 240, 280 * 1.2 / 1.17, 280 * 1.2 / 1.17, 159.5, 119.5)
    view = View(CAMERA, transform(translation=(0.0, 0.0, 0.03)))
    misalignment = reference.misalignment(seen(turn, rng, camera=nearer), view, 1.2, NO_TURN)
    assert np.abs(misalignment.rotation - turn)[:2].max() < 0.1 * PX
    assert np.sqrt(np.diag(misalignment.cov)[:2]).max() < 0.1 * PX


def test_where_too_few_corners_are_in_view_or_found_again_there_is_no_rotation(reference, rng):
    """Another scene; the camera is told to look elsewhere; the image shows nothing, or its corners in a part alone."""
    image_at_rest = seen(NO_TURN, rng)
    away = View(CAMERA, transform(cv2.Rodrigues(np.deg2rad([0.0, 60.0, 0.0]))[0]))
    plain = np.full((240, 320, 3), 128, np.uint8)
    for image, view in (
        (np.ascontiguousarray(image_at_rest[::-1, ::-1]), STILL),
        (image_at_rest, away),
        (plain, STILL),
        (covered(image_at_rest, 0.8), STILL),
    ):
        assert reference.misalignment(image, view, 1.2, NO_TURN) is None
    noisy = np.clip(np.rint(plain + 6 * rng.standard_normal(plain.shape)), 0, 255).astype(np.uint8)
    without_corners = Reference(CAMERA, noisy, np.eye(4))
    assert not without_corners.has_corners
    assert not without_corners.is_still(noisy)


def test_an_error_of_the_rooms_depth_turns_what_is_found_as_stated(rng):
    """The reference pose is off by 3 cm: the nearer the background, the larger the apparent rotation."""
    reference = Reference(CAMERA, seen(NO_TURN, rng), transform(translation=(0.03, -0.01, 0.0)))
    image = seen(NO_TURN, rng)
    distant, near = (reference.misalignment(image, STILL, 1 / inverse_m, NO_TURN) for inverse_m in (0.8, 0.9))
    stated = 0.05 * (distant.by_parallax + near.by_parallax)
    assert abs(stated[1]) > 2e-3
    np.testing.assert_allclose(near.rotation - distant.rotation, -stated, rtol=0.1, atol=2e-4)
