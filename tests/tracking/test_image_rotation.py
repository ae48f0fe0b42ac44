"""Rotation of a camera against a photograph-like wall, drawn by a homography: the truth is the homography's."""

import cv2
import numpy as np
import pytest
from far_wall import CAMERA, far_wall, seen

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.se3 import transform
from pps_vision.types import Image
from tracking.image_rotation import Reference, _fitted_rotation

STILL = View(CAMERA, np.eye(4))
NO_TURN = np.zeros(3)
PX = 1 / CAMERA.fx


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
        ((0.0, 1.0, 0.0), None, 0.05),
        ((0.3, -0.6, 0.5), None, 0.05),
        ((-1.5, 2.0, 1.0), None, 0.05),
        ((0.05, 0.0, -0.05), None, 0.05),
        ((0.0, 0.5, 0.0), lambda image: covered(image, 0.3), 0.1),
        # Lucas–Kanade alone takes the change of light for motion, of twice as much as is allowed here
        ((0.3, -0.6, 0.5), lambda image: brighter(image, 0.9), 0.1),
        ((0.3, -0.6, 0.5), lambda image: brighter(image, 1.1), 0.1),
    ],
)
def test_a_rotation_is_measured_to_a_twentieth_of_a_pixel(degrees, change, off_px, reference, rng):
    """A tenth where a third of the image is covered, or under another light."""
    turn = np.deg2rad(degrees)
    image = seen(turn, rng)
    image = image if change is None else change(image)
    error = reference.misalignment(image, STILL, 1.2, NO_TURN).rotation - turn
    assert np.abs(error[:2]).max() < off_px * PX
    assert abs(error[2]) < 2 * off_px * PX
    assert not reference.is_still(image)


def test_a_rotation_is_measured_in_large_images(rng):
    """Of 641×481 pixels, of which two by two are joined."""
    camera = Camera(641, 481, 560.0, 560.0, 319.5, 239.5)
    turn = np.deg2rad([0.3, -0.6, 0.5])
    reference = Reference(camera, seen(NO_TURN, rng, camera=camera), np.eye(4))
    assert reference.is_still(seen(NO_TURN, rng, camera=camera))
    misalignment = reference.misalignment(seen(turn, rng, camera=camera), View(camera, np.eye(4)), 1.2, NO_TURN)
    assert np.abs(misalignment.rotation - turn)[:2].max() < 0.1 * PX


def test_a_rotation_is_measured_on_a_blurred_wall(rng):
    """Low contrast out of focus: corners are told by more pixels."""
    soft = cv2.GaussianBlur((64 + far_wall() / 2).astype(np.uint8), (0, 0), 2.0)
    turn = np.deg2rad([0.1, -0.2, 0.0])
    reference = Reference(CAMERA, seen(NO_TURN, rng, wall=soft), np.eye(4))
    assert reference.has_corners
    assert reference.is_still(seen(NO_TURN, rng, wall=soft))
    image = seen(turn, rng, wall=soft)
    assert not reference.is_still(image)
    assert np.abs(reference.misalignment(image, STILL, 1.2, NO_TURN).rotation - turn)[:2].max() < 0.1 * PX


def test_an_eye_that_rests_is_still_through_noise_and_a_change_of_light(reference, rng):
    for _ in range(5):
        assert reference.is_still(seen(NO_TURN, rng, noise=4.0))
        assert reference.is_still(brighter(seen(NO_TURN, rng), 0.9))


@pytest.mark.parametrize(("shift_px", "still"), [(0.07, True), (0.14, False)])
def test_an_eye_is_still_where_corners_move_by_less_than_a_tenth_of_a_pixel(shift_px, still, rng):
    reference = Reference(CAMERA, seen(NO_TURN, rng, noise=0.5), np.eye(4))
    for way in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)):
        assert reference.is_still(seen(shift_px * PX * np.array(way), rng, noise=0.5)) == still


def test_a_told_rotation_is_no_error(reference, rng):
    turn = np.deg2rad([0.4, -1.2, 0.2])
    nominal = View(CAMERA, transform(cv2.Rodrigues(turn)[0]))
    misalignment = reference.misalignment(seen(turn, rng), nominal, 1.2, NO_TURN)
    assert np.abs(misalignment.rotation[:2]).max() < 0.05 * PX


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


def test_the_stated_covariance_is_the_scatter_of_the_rotations(rng):
    """400 fits to directions with Gaussian noise; the small efficiency loss of robust weights is not modelled."""
    n = 60
    bearings = rng.standard_normal((n, 3)) * (0.3, 0.1, 0.0) + (0.2, 0.0, 1.0)
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    turn = np.array([0.02, -0.03, 0.01])
    exact = bearings @ cv2.Rodrigues(turn)[0]  # exp(w)ᵀ turns each of them
    errors = []
    stated = []
    for _ in range(400):
        after = exact + 1e-3 * rng.standard_normal(exact.shape)
        after /= np.linalg.norm(after, axis=1, keepdims=True)
        w, cov, _, agreeing = _fitted_rotation(bearings, after, np.zeros(3), np.zeros(3), (1e-4, 1e-2))
        assert agreeing > n / 2
        errors.append(w - turn)
        stated.append(cov)
    mean_cov = np.mean(stated, axis=0)
    share = np.linalg.eigvals(np.linalg.solve(mean_cov, np.cov(np.array(errors).T)))
    assert ((share > 0.7) & (share < 1.5)).all()
    assert np.abs(np.mean(errors, axis=0)).max() < 4 * np.sqrt(mean_cov.diagonal().max() / 400)


def test_an_error_of_the_rooms_depth_turns_what_is_found_as_stated(rng):
    """The reference pose is off by 3 cm: the nearer the background, the larger the apparent rotation."""
    reference = Reference(CAMERA, seen(NO_TURN, rng), transform(translation=(0.03, -0.01, 0.0)))
    image = seen(NO_TURN, rng)
    distant, near = (reference.misalignment(image, STILL, 1 / inverse_m, NO_TURN) for inverse_m in (0.8, 0.9))
    stated = 0.05 * (distant.by_parallax + near.by_parallax)
    assert abs(stated[1]) > 2e-3
    np.testing.assert_allclose(near.rotation - distant.rotation, -stated, rtol=0.1, atol=2e-4)
