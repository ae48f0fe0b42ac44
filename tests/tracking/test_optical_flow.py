"""Flow of regions on drawn images whose motion is known, and warping between poses against the projection of points."""

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import LEFT_EYE
from pps_vision.types import Array
from tracking.camera_pose import EgoMotion
from tracking.motion_trigger import GreyImage, Match, match

VIEW = View(LEFT_EYE, transform())
BOX = (150, 110, 30, 30)


def texture(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    return cv2.GaussianBlur(rng.uniform(0, 255, shape), (0, 0), 1.5).astype(np.uint8)


def pair(rng: np.random.Generator, object_px: tuple[int, int], wall_px: tuple[int, int] = (0, 0)) -> list[np.ndarray]:
    """A textured square before a textured wall, then both moved by whole pixels so that the square fills BOX."""
    wall = texture(rng, (240, 320))
    square = texture(rng, (30, 30))
    images = [wall, np.roll(wall, wall_px[::-1], (0, 1))]
    x, y = BOX[:2]
    for image, (dx, dy) in zip(images, (object_px, (0, 0)), strict=True):
        image[y - dy : y - dy + 30, x - dx : x - dx + 30] = square
    return images


def measured(
    images: list[np.ndarray], older: View = VIEW, tolerance_px: float = 1.0, part: tuple[slice, slice] = np.s_[:, :]
) -> Match:
    """Flow of a part of BOX."""
    mask = np.zeros((30, 30), bool)
    mask[part] = True
    old = GreyImage(images[0], older)
    new = GreyImage(images[1], VIEW)
    return match(EgoMotion(LEFT_EYE), old, new, 1.2, tolerance_px, [(BOX, mask)])[0]


@pytest.mark.parametrize("moved", [(3, -2), (-5, 1), (1, -1)])
def test_a_region_that_moves_does(rng, moved):
    assert measured(pair(rng, moved)).moving > 0.7
    assert measured(pair(rng, moved), part=np.s_[13:16, 13:16]).moving > 0.4


def test_what_comes_along_the_line_of_sight_moves_although_its_flow_has_no_direction(rng):
    """The square grows by a fifth about its centre: points at its rim move by 2.5 px, in all directions."""
    images = pair(rng, (0, 0))
    place = np.s_[110:140, 150:180]
    grow = np.array([[1.2, 0, -0.2 * 14.5], [0, 1.2, -0.2 * 14.5]])
    images[1][place] = cv2.warpAffine(images[0][place], grow, (30, 30))
    result = measured(images)
    assert result.moving >= 0.5


def test_what_moves_with_its_surroundings_does_not_move(rng):
    result = measured(pair(rng, (2, 1), (2, 1)))
    assert result.moving == 0
    assert result.unmatched < 0.2
    assert measured(pair(rng, (5, 1), (2, 1))).moving > 0.7


def test_little_motion_is_none(rng):
    images = pair(rng, (0, 0))
    place = np.s_[110:140, 150:180]
    images[1][place] = cv2.warpAffine(images[0], np.array([[1, 0, 0.3], [0, 1, 0]]), (320, 240))[place]
    assert measured(images).moving == 0
    assert measured(images, tolerance_px=0.15).moving > 0.5
    images[1][place] = texture(rng, (30, 30))  # new texture has no match
    result = measured(images)
    assert result.unmatched > 0.75
    assert result.moving < 0.25


def test_the_eyes_own_motion_is_no_flow(rng):
    turned = View(LEFT_EYE, transform(rotation=cv2.Rodrigues(np.array([0.0, 0.02, 0.0]))[0]))
    for moved_px in (0, 4):
        old, new = pair(rng, (moved_px, 0))
        older = EgoMotion(LEFT_EYE).warp(old, VIEW, turned, 0.0)  # the same scene, far away, from the older pose
        result = measured([older, new], turned)
        assert (result.moving > 0) == (moved_px > 0)
        assert result.unmatched < 0.2


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
