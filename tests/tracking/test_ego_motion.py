"""Warping between poses of a camera, against the projection of points at the distance that is asked for."""

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.se3 import transform
from pps_vision.types import Array
from tracking.ego_motion import EgoMotion

LENS = Camera(173, 131, 150.0, 152.0, 84.0, 66.0, (-0.3, 0.09, 0.001, -0.0005, 0.0))
THEN = View(LENS, transform(cv2.Rodrigues(np.array([0.1, -0.2, 0.05]))[0], (0.1, 0.2, 0.3)))
NOW = View(LENS, transform(cv2.Rodrigues(np.array([0.13, -0.17, 0.02]))[0], (0.11, 0.18, 0.31)))


def exact(inverse_distance: float) -> Array:
    """(h, w, 2) where `THEN` saw the points at that distance along the lines of sight of `NOW`; NaN: nowhere."""
    v, u = np.mgrid[: LENS.height, : LENS.width]
    rays = NOW.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    points = rays * 1e9 if inverse_distance == 0 else NOW.center + rays / inverse_distance
    return np.asarray(THEN.project(points)).reshape(LENS.height, LENS.width, 2)


@pytest.mark.parametrize("inverse_distance", [0.0, 0.5, 2.0])
def test_each_pixel_is_where_the_older_image_showed_it(inverse_distance):
    maps = EgoMotion(LENS).maps(THEN, NOW, inverse_distance)
    expected = exact(inverse_distance)
    off = np.linalg.norm(maps - expected, axis=-1)
    assert np.nanmax(off) < 0.05
    assert maps.shape == (LENS.height, LENS.width, 2)


@pytest.mark.parametrize("box", [(0, 0, 173, 131), (8, 16, 24, 40), (5, 3, 170, 129), (33, 47, 34, 48)])
def test_a_box_is_a_part_of_the_whole(box):
    motion = EgoMotion(LENS)
    whole = motion.maps(THEN, NOW, 1.0)
    x0, y0, x1, y1 = box
    np.testing.assert_allclose(motion.maps(THEN, NOW, 1.0, box), whole[y0:y1, x0:x1], atol=1e-3)


def test_what_was_behind_the_camera_is_far_outside_the_older_image():
    behind = View(LENS, THEN.T_root_camera @ transform(np.diag([-1.0, 1.0, -1.0])))
    maps = EgoMotion(LENS).maps(THEN, behind, 0.5)
    assert ((maps < -1000).all(axis=-1) | (np.abs(maps) > 1000).any(axis=-1)).all()
    image = np.full((LENS.height, LENS.width, 3), 200, np.uint8)
    assert not EgoMotion(LENS).warp(image, THEN, behind, 0.5).any()


def test_a_warped_image_shows_what_the_older_one_showed_there():
    """A smooth image, whose brightness at a place is known between pixels as well."""

    def level(px: Array) -> Array:
        return np.asarray(120 + 60 * np.sin(px[..., 0] / 20) + 40 * np.cos(px[..., 1] / 15))

    v, u = np.mgrid[: LENS.height, : LENS.width]
    image = np.rint(level(np.stack([u, v], axis=-1))).astype(np.uint8)
    warped = EgoMotion(LENS).warp(image, THEN, NOW, 0.5)
    expected = exact(0.5)
    inside = ((expected > 1) & (expected < [LENS.width - 2, LENS.height - 2])).all(axis=-1)
    assert inside.mean() > 0.5
    assert np.abs(warped - level(expected))[inside].max() < 1.5
    outside = ((expected < -2) | (expected > [LENS.width + 1, LENS.height + 1])).any(axis=-1)
    assert outside.any()
    assert not warped[outside].any()
    box = (40, 30, 90, 77)
    assert np.array_equal(EgoMotion(LENS).warp(image, THEN, NOW, 0.5, box), warped[30:77, 40:90])


def test_still_is_what_moves_no_pixel():
    def moved(rotation: float, shift: float) -> View:
        return View(LENS, THEN.T_root_camera @ transform(cv2.Rodrigues(np.array([0, rotation, 0]))[0], (0, shift, 0)))

    assert EgoMotion.is_still(THEN, THEN)
    assert EgoMotion.is_still(THEN, moved(2e-6, 2e-6))  # a hundredth of a pixel is 7e-5 rad here
    assert not EgoMotion.is_still(THEN, moved(1e-4, 0.0))
    assert not EgoMotion.is_still(THEN, moved(0.0, 1e-4))
    assert not EgoMotion.is_still(THEN, moved(0.0, -1e-4))


def test_parallax_is_the_images_shift_for_each_inverse_metre():
    """Aside by 1 cm: two points ahead, 1 m and 0.5 m away, are 1.5 px further apart than before."""
    pinhole = Camera(160, 120, 150.0, 150.0, 79.5, 59.5)
    earlier = View(pinhole, np.eye(4))
    current = View(pinhole, transform(translation=(0.01, 0.0, 0.0)))
    distance_m, near = (current.center + np.array([0.0, 0.0, z]) for z in (1.0, 0.5))
    apart = np.linalg.norm(np.asarray(earlier.project(near)) - np.asarray(earlier.project(distance_m)))
    assert EgoMotion(pinhole).parallax_px_m(earlier, current) == pytest.approx(apart)
