"""Markers of a known hue: which colours count, which blobs, and in which order."""

import colorsys

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera
from pps_vision.types import Image
from tracking.marker import MarkerParams, find_markers, find_vivid_markers, threshold
from tracking.outline import Optics

OPTICS = Optics(Camera(160, 120, 150.0, 150.0, 79.5, 59.5))
GREEN = (20, 220, 30)


def plain(hue_deg: float, saturation: float = 1.0, value: float = 1.0) -> Image:
    color = np.rint(255 * np.array(colorsys.hsv_to_rgb(hue_deg / 360, saturation, value)))
    return np.full((1, 1, 3), color, np.uint8)


def drawn(*discs: tuple[int, int, int]) -> Image:
    image = np.full((120, 160, 3), (90, 80, 100), np.uint8)
    for x, y, radius in discs:
        cv2.circle(image, (x, y), radius, GREEN, cv2.FILLED)
    return image


@pytest.mark.parametrize("hue_deg", [0.0, 10.0, 120.0, 240.0, 350.0])
@pytest.mark.parametrize("tolerance_deg", [20.0, 35.0, 90.0])
def test_hues_within_the_tolerance_count_around_the_whole_circle(hue_deg, tolerance_deg):
    params = MarkerParams(hue_deg, tolerance_deg)
    for off in (-tolerance_deg - 3, -tolerance_deg + 3, 0.0, tolerance_deg - 3, tolerance_deg + 3, 180.0):
        assert (threshold(params, plain((hue_deg + off) % 360)).item() == 255) == (abs(off) < tolerance_deg)


def test_pale_and_dark_colours_do_not_count():
    params = MarkerParams(120.0)
    assert [threshold(params, plain(120.0, s)).item() for s in (0.47, 0.53, 1.0)] == [0, 255, 255]
    assert [threshold(params, plain(120.0, 1.0, v)).item() for v in (0.10, 0.14, 1.0)] == [0, 255, 255]


@pytest.mark.parametrize("change", [(-1.0, 35.0), (360.0, 35.0), (120.0, 0.0), (120.0, 91.0), (np.nan, 35.0)])
def test_a_hue_or_tolerance_that_is_none_is_refused(change):
    with pytest.raises(ValueError, match="expected a hue in"):
        MarkerParams(*change)
    assert MarkerParams(0.0, 90.0).hue_deg == 0


def test_the_largest_comes_first_and_at_most_four():
    """A round blob before a longer one of more area; a speck of fewer than 8 px is none."""
    image = drawn((20, 20, 4), (60, 20, 9), (110, 30, 6), (30, 80, 12), (90, 90, 5))
    centers = [marker.center_px.round().tolist() for marker in find_markers(MarkerParams(), image, OPTICS)]
    assert centers == [[30, 80], [60, 20], [110, 30], [90, 90]]
    image = drawn((40, 60, 8))
    image[20:25, 70:150] = GREEN
    assert find_markers(MarkerParams(), image, OPTICS)[0].center_px == pytest.approx([40, 60], abs=0.3)
    image = drawn()
    image[50:52, 50:54] = GREEN
    image[80:82, 80:83] = GREEN
    markers = find_markers(MarkerParams(), image, OPTICS)
    assert [marker.center_px.round(1).tolist() for marker in markers] in ([[51.5, 50.5]], [])
    assert len(find_markers(MarkerParams(), drawn((50, 50, 3)), OPTICS)) == 1


@pytest.mark.parametrize(
    ("near", "columns"),
    [
        ((112, 58, 20), [110]),
        ((75, 60, 20), []),
        ((75, 60, 60), [40, 110]),
        *((beyond, []) for beyond in ((-50, 60, 20), (300, 60, 20), (75, -50, 20), (75, 300, 20))),
        ((0, 0, 9), [4]),
        ((159, 119, 9), [155]),
    ],
)
def test_only_the_square_that_is_asked_for_is_searched(near, columns):
    markers = find_markers(
        MarkerParams(), drawn((40, 60, 6), (110, 60, 6), (4, 4, 3), (155, 115, 3)), OPTICS, near=near
    )
    assert sorted(marker.center_px[0].round() for marker in markers) == columns


def test_what_does_not_differ_from_the_background_is_left_out():
    image = drawn((40, 60, 6), (110, 60, 6))
    boxes = []

    def differs(box: tuple[int, int, int, int]) -> np.ndarray:
        boxes.append(box)
        return np.broadcast_to(np.arange(box[0], box[2]) > 80, (box[3] - box[1], box[2] - box[0]))

    (marker,) = find_markers(MarkerParams(), image, OPTICS, differs=differs)
    assert marker.center_px == pytest.approx([110, 60], abs=0.1)
    (marker,) = find_markers(MarkerParams(), image, OPTICS, near=(100, 60, 70), differs=differs)
    assert marker.center_px == pytest.approx([110, 60], abs=0.1)
    assert boxes == [(0, 0, 160, 120), (30, 0, 160, 120)]


def _common_hue(rng: np.random.Generator, more: float, share: float) -> Image:
    """Greens whose saturation has a standard deviation of 10 in a share of the image; a disc by `more` of these more
    saturated."""
    saturation = np.rint(150 + 10 * rng.standard_normal((120, 160)))
    saturation[:, round(160 * share) :] = 0
    disc = np.zeros((120, 160), np.uint8)
    cv2.circle(disc, (110, 60), 8, (1,), cv2.FILLED)
    red_blue = 255 - np.where(disc > 0, 150 + 10 * more, saturation)
    return np.stack([red_blue, np.full((120, 160), 255.0), red_blue], axis=-1).astype(np.uint8)


@pytest.mark.parametrize(("more", "share", "n"), [(5, 1.0, 1), (3, 1.0, 0), (5, 0.2, 1), (5, 0.0, 0)])
def test_what_stands_out_of_a_common_hue_by_four_deviations_is_a_marker(more, share, n, rng):
    """A hue that only the disc has (1 % of the image) is no common one."""
    vivid = find_vivid_markers(MarkerParams(120.0), _common_hue(rng, more, share), OPTICS)
    assert [marker.center_px.round().tolist() for marker in vivid] == [[110, 60]] * n
    pure = np.full((120, 160, 3), (0, 255, 0), np.uint8)
    assert find_vivid_markers(MarkerParams(120.0), pure, OPTICS) == []  # nothing can be more saturated
