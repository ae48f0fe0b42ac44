"""Operations on masks, of shapes whose result is known."""

import cv2
import numpy as np
import pytest

from pps_vision.geometry import masks
from pps_vision.types import Mask


def rectangle(x0: int, y0: int, x1: int, y1: int, shape: tuple[int, int] = (60, 80)) -> Mask:
    mask = np.zeros(shape, bool)
    mask[y0:y1, x0:x1] = True
    return mask


def disc(x: float, y: float, radius: float) -> Mask:
    v, u = np.mgrid[:60, :80]
    return np.asarray(np.hypot(u - x, v - y) <= radius)


@pytest.mark.parametrize(("gap", "is_closed"), [(2, True), (4, True), (5, False)])
def test_closing_fills_gaps_narrower_than_the_element(gap, is_closed):
    two = rectangle(10, 10, 30, 40) | rectangle(30 + gap, 10, 50, 40)
    result = masks.closed(two, masks.square(2))
    assert result[20, 30 : 30 + gap].all() == is_closed
    assert np.array_equal(result, rectangle(10, 10, 50, 40) if is_closed else two)


@pytest.mark.parametrize("radius", [0, 3, 12, 40])
def test_opening_keeps_what_a_disc_reaches_that_fits_up_to_the_images_border(radius):
    """By OpenCV's exact distances to the nearest pixel outside, and to the nearest centre of a disc that fits."""
    rng = np.random.default_rng(radius)
    y, x = np.mgrid[:90, :130]
    for share in (0.1, 0.5, 0.9):
        noise = cv2.GaussianBlur(rng.random((90, 130)), (0, 0), 4.0)
        mask = (noise > np.quantile(noise, share)) | (np.hypot(x - 20, y - 50) < 45)
        inside = cv2.distanceTransform(mask.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        centers = inside > radius
        reached = cv2.distanceTransform((~centers).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) <= radius
        np.testing.assert_array_equal(masks.opened(mask, radius), reached & centers.any())


def test_the_component_is_the_one_with_most_pixels_where_it_is_asked_for():
    large = rectangle(5, 5, 25, 25)
    small = rectangle(40, 5, 45, 10)
    mask = large | small | rectangle(25, 25, 30, 30)  # touching at a corner
    for seed, expected in (((20, 0, 50, 10), large), ((21, 0, 50, 10), small)):  # of as many pixels, the first
        np.testing.assert_array_equal(masks.component(mask, rectangle(*seed)), expected)
    assert masks.component(mask, rectangle(0, 40, 20, 60)) is None


@pytest.mark.parametrize(("gap", "is_one"), [(2, True), (3, False)])
def test_parts_up_to_two_pixels_apart_are_one_thing(gap, is_one):
    near = rectangle(10, 10, 30, 40)
    two = near | rectangle(30 + gap, 10, 50, 40)
    expected = rectangle(10, 10, 50, 40) if is_one else near
    np.testing.assert_array_equal(masks.closed_component(two, rectangle(12, 12, 20, 20)), expected)


def test_holes_are_filled_but_for_large_ones_that_show_the_backdrop():
    ring = disc(40, 30, 25)
    large = disc(40, 30, 10)
    mask = ring & ~large & ~rectangle(55, 30, 57, 32)  # 4 px are less than 1 % of it
    everywhere = np.ones_like(mask)
    left_half = large & (np.arange(80) < 40)
    right_half = large & (np.arange(80) >= 38)
    for backdrop, expected in (
        (None, ring),
        (everywhere, ring & ~large),
        (~everywhere, ring),
        (left_half, ring),  # less than half of the hole
        (right_half, ring & ~large),
    ):
        np.testing.assert_array_equal(masks.filled(mask, *([] if backdrop is None else [backdrop])), expected)


@pytest.mark.parametrize(
    ("side", "mask"),
    [(0, (0, 5, 9, 9)), (1, (5, 0, 9, 9)), (2, (70, 5, 80, 9)), (3, (5, 50, 9, 60))],
    ids=["left", "top", "right", "bottom"],
)
def test_a_mask_is_cut_where_it_reaches_a_side_that_is_not_the_images(side, mask):
    image = np.zeros((100, 200, 3), np.uint8)
    inside = (50, 20, 130, 80)
    corner = [(0, 20), (50, 0), (120, 20), (50, 40)][side]
    at_side = (*corner, corner[0] + 80, corner[1] + 60)
    assert masks.is_cut(rectangle(*mask), inside, image)
    assert not masks.is_cut(rectangle(*mask), at_side, image)
    assert not masks.is_cut(rectangle(5, 5, 79, 59), inside, image)


def test_an_ellipse_has_its_width_height_and_centre():
    result = masks.ellipse((10, 20, 90, 80), np.array([45.0, 55.0]), 40.0, 20.0)
    assert result.shape == (60, 80)
    v, u = np.nonzero(result)
    assert (u.min() + 10, u.max() + 10, v.min() + 20, v.max() + 20) == (25, 65, 45, 65)
    assert result.sum() == pytest.approx(np.pi / 4 * 40 * 20, rel=0.02)


def test_solidity_is_the_share_of_the_convex_hull():
    """A square is solid, three of its quarters fill 6/7 of the hull; a pixel is solid."""
    square = rectangle(10, 5, 60, 55)
    quarter = rectangle(35, 5, 60, 30)
    assert masks.solidity(square) == pytest.approx(1, abs=0.05)
    assert masks.solidity(square & ~quarter) == pytest.approx(6 / 7, abs=0.05)
    assert masks.solidity(rectangle(3, 3, 4, 4)) == 1
