"""Rotation of a camera against a photograph-like wall, drawn by a homography: the truth is the homography's."""

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.se3 import transform
from pps_vision.types import Array, Image
from tracking.image_rotation import Reference, _fitted_rotation

CAMERA = Camera(320, 240, 280.0, 280.0, 159.5, 119.5)
STILL = View(CAMERA, np.eye(4))


@pytest.fixture
def wall(rng: np.random.Generator) -> Image:
    """(480, 640, 3) blobs of all sizes."""
    layers = [
        cv2.resize(rng.normal(0, 30, (480 // k, 640 // k, 1)), (640, 480), interpolation=cv2.INTER_CUBIC)
        for k in (6, 12, 24, 60)
    ]
    return np.clip(128 + np.sum(layers, axis=0)[..., None] + np.zeros(3), 0, 255).astype(np.uint8)


def seen(wall: Image, rotation: Array, rng: np.random.Generator, noise: float = 2.0, camera: Camera = CAMERA) -> Image:
    """The wall from a camera turned by a rotation vector (T_root_camera), with pixel noise."""
    R = cv2.Rodrigues(np.asarray(rotation, float))[0]
    to_wall = np.array([[1.0, 0, 160], [0, 1, 120], [0, 0, 1]])
    H = to_wall @ CAMERA.K @ R @ np.linalg.inv(camera.K)
    size = camera.width, camera.height
    image = cv2.warpPerspective(wall, H, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP).astype(float)
    return np.clip(np.rint(image + noise * rng.standard_normal(image.shape)), 0, 255).astype(np.uint8)


def covered(image: Image, share: float) -> Image:
    """A plain board with a bright edge over the left part of the image."""
    out = image.copy()
    x = round(share * image.shape[1])
    out[:, :x] = (90, 60, 30)
    out[:, max(x - 2, 0) : x] = 255
    return out


@pytest.mark.parametrize("degrees", [(0.0, 1.0, 0.0), (0.3, -0.6, 0.5), (-1.5, 2.0, 1.0), (0.05, 0.0, -0.05)])
def test_a_rotation_is_measured_to_a_twentieth_of_a_pixel(wall, degrees, rng):
    turn = np.deg2rad(degrees)
    reference = Reference(CAMERA, seen(wall, np.zeros(3), rng), np.eye(4))
    image = seen(wall, turn, rng)
    misalignment = reference.misalignment(image, STILL, 1.2, np.zeros(3))
    assert np.abs(misalignment.rotation - turn)[:2].max() < 0.05 / CAMERA.fx
    assert abs(misalignment.rotation[2] - turn[2]) < 0.1 / CAMERA.fx
    assert not reference.is_still(image)


def test_a_rotation_is_measured_in_large_images(wall, rng):
    """Of 641×481 pixels, of which two by two are joined."""
    camera = Camera(641, 481, 560.0, 560.0, 319.5, 239.5)
    turn = np.deg2rad([0.3, -0.6, 0.5])
    reference = Reference(camera, seen(wall, np.zeros(3), rng, camera=camera), np.eye(4))
    assert reference.is_still(seen(wall, np.zeros(3), rng, camera=camera))
    misalignment = reference.misalignment(
        seen(wall, turn, rng, camera=camera), View(camera, np.eye(4)), 1.2, np.zeros(3)
    )
    assert np.abs(misalignment.rotation - turn)[:2].max() < 0.1 / CAMERA.fx


def test_an_eye_that_rests_is_still_through_noise_and_a_change_of_light(wall, rng):
    reference = Reference(CAMERA, seen(wall, np.zeros(3), rng), np.eye(4))
    for _ in range(5):
        assert reference.is_still(seen(wall, np.zeros(3), rng, noise=4.0))
        assert reference.is_still(np.clip(0.9 * seen(wall, np.zeros(3), rng), 0, 255).astype(np.uint8))


@pytest.mark.parametrize(("shift_px", "still"), [(0.07, True), (0.14, False)])
def test_an_eye_is_still_where_corners_move_by_less_than_a_tenth_of_a_pixel(shift_px, still, wall, rng):
    reference = Reference(CAMERA, seen(wall, np.zeros(3), rng, noise=0.5), np.eye(4))
    for way in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)):
        turn = shift_px / CAMERA.fx * np.array(way)
        assert reference.is_still(seen(wall, turn, rng, noise=0.5)) == still


def test_a_rotation_is_measured_on_a_blurred_wall(wall, rng):
    """Low contrast out of focus: corners are told by more pixels."""
    soft = cv2.GaussianBlur((64 + wall / 2).astype(np.uint8), (0, 0), 2.0)
    turn = np.deg2rad([0.1, -0.2, 0.0])
    reference = Reference(CAMERA, seen(soft, np.zeros(3), rng), np.eye(4))
    assert reference.has_corners
    assert reference.is_still(seen(soft, np.zeros(3), rng))
    image = seen(soft, turn, rng)
    assert not reference.is_still(image)
    misalignment = reference.misalignment(image, STILL, 1.2, np.zeros(3))
    assert np.abs(misalignment.rotation - turn)[:2].max() < 0.1 / CAMERA.fx


def test_a_told_rotation_is_no_error(wall, rng):
    turn = np.deg2rad([0.4, -1.2, 0.2])
    reference = Reference(CAMERA, seen(wall, np.zeros(3), rng), np.eye(4))
    nominal = View(CAMERA, transform(cv2.Rodrigues(turn)[0]))
    misalignment = reference.misalignment(seen(wall, turn, rng), nominal, 1.2, np.zeros(3))
    assert np.abs(misalignment.rotation[:2]).max() < 0.05 / CAMERA.fx


def test_what_covers_a_third_of_the_image_turns_nothing(wall, rng):
    turn = np.deg2rad([0.0, 0.5, 0.0])
    reference = Reference(CAMERA, seen(wall, np.zeros(3), rng), np.eye(4))
    misalignment = reference.misalignment(covered(seen(wall, turn, rng), 0.3), STILL, 1.2, np.zeros(3))
    assert np.abs(misalignment.rotation - turn)[:2].max() < 0.1 / CAMERA.fx


def test_another_scene_is_no_rotation(wall, rng):
    reference = Reference(CAMERA, seen(wall, np.zeros(3), rng), np.eye(4))
    other_image = np.ascontiguousarray(seen(wall, np.zeros(3), rng)[::-1, ::-1])
    assert reference.misalignment(other_image, STILL, 1.2, np.zeros(3)) is None


def test_a_plain_wall_has_no_corners(rng):
    plain = np.clip(np.rint(128 + 6 * rng.standard_normal((240, 320, 3))), 0, 255).astype(np.uint8)
    reference = Reference(CAMERA, plain, np.eye(4))
    assert not reference.has_corners
    assert not reference.is_still(plain)


def test_the_stated_covariance_is_the_scatter_of_the_rotations(rng):
    """400 fits to directions with Gaussian noise; the small efficiency loss of robust weights is not modelled."""
    n = 60
    noise = 1e-3
    bearings = rng.standard_normal((n, 3)) * (0.3, 0.1, 0.0) + (0.2, 0.0, 1.0)
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    turn = np.array([0.02, -0.03, 0.01])
    exact = bearings @ cv2.Rodrigues(turn)[0]  # exp(w)ᵀ turns each of them
    misalignment = []
    stated = []
    for _ in range(400):
        after = exact + noise * rng.standard_normal(exact.shape)
        after /= np.linalg.norm(after, axis=1, keepdims=True)
        w, cov, _, agreeing = _fitted_rotation(bearings, after, np.zeros(3), np.zeros(3), (1e-4, 1e-2))
        assert agreeing > n / 2
        misalignment.append(w - turn)
        stated.append(cov)
    share = np.linalg.eigvals(np.linalg.solve(np.mean(stated, axis=0), np.cov(np.array(misalignment).T)))
    assert ((share > 0.7) & (share < 1.5)).all()
    assert np.abs(np.mean(misalignment, axis=0)).max() < 4 * np.sqrt(np.mean(stated, axis=0).diagonal().max() / 400)


def test_a_rotation_is_measured_under_another_light(wall, rng):
    """Lucas–Kanade alone takes the change for motion, of twice as much as is allowed here."""
    turn = np.deg2rad([0.3, -0.6, 0.5])
    reference = Reference(CAMERA, seen(wall, np.zeros(3), rng), np.eye(4))
    for gain in (0.9, 1.1):
        image = np.clip(gain * seen(wall, turn, rng).astype(float), 0, 255).astype(np.uint8)
        misalignment = reference.misalignment(image, STILL, 1.2, np.zeros(3))
        assert np.abs(misalignment.rotation - turn)[:2].max() < 0.1 / CAMERA.fx


def test_where_too_few_corners_are_in_view_or_found_again_there_is_no_rotation(wall, rng):
    """The camera is told to look elsewhere, or the image shows nothing, or its corners in a part alone."""
    reference = Reference(CAMERA, seen(wall, np.zeros(3), rng), np.eye(4))
    away = View(CAMERA, transform(cv2.Rodrigues(np.deg2rad([0.0, 60.0, 0.0]))[0]))
    plain = np.full((240, 320, 3), 128, np.uint8)
    assert reference.misalignment(seen(wall, np.zeros(3), rng), away, 1.2, np.zeros(3)) is None
    assert reference.misalignment(plain, STILL, 1.2, np.zeros(3)) is None
    assert reference.misalignment(covered(seen(wall, np.zeros(3), rng), 0.8), STILL, 1.2, np.zeros(3)) is None


def test_an_error_of_the_rooms_depth_turns_what_is_found_as_stated(wall, rng):
    """The reference pose is off by 3 cm: the nearer the background, the larger the apparent rotation."""
    aside = transform(translation=(0.03, -0.01, 0.0))
    reference = Reference(CAMERA, seen(wall, np.zeros(3), rng), aside)
    image = seen(wall, np.zeros(3), rng)
    distance_m, near = (reference.misalignment(image, STILL, 1 / inverse_m, np.zeros(3)) for inverse_m in (0.8, 0.9))
    stated = 0.05 * (distance_m.by_parallax + near.by_parallax)
    assert abs(stated[1]) > 2e-3
    np.testing.assert_allclose(near.rotation - distance_m.rotation, -stated, rtol=0.1, atol=2e-4)
