"""Markers of a known hue: which colours count, and which blobs."""

import colorsys

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera
from pps_vision.types import Image
from tracking.marker import MarkerParams, colors_of, find_markers, threshold
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


def _before(color: tuple[int, int, int], rng: np.random.Generator) -> Image:
    """A green disc that touches a wide patch of another colour, with noise."""
    image = drawn((60, 60, 12)).astype(float)
    image[40:80, 66:150] = color
    cv2.circle(image, (60, 60), 12, GREEN, cv2.FILLED)
    return np.clip(image + 2 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("patch", [plain(120.0, 0.6, 0.8), plain(145.0, 0.95, 0.8), plain(95.0, 0.95, 0.8)])
def test_a_marker_before_something_of_its_hue_is_found_by_a_part_of_the_range(patch, rng):
    """By saturation, or by hue; its own colours then tell it from the patch, and count wholly within the range."""
    image = _before(tuple(patch[0, 0].tolist()), rng)

    def centers(params: MarkerParams) -> list[list[float]]:
        return [marker.center_px.round().tolist() for marker in find_markers(params, image, OPTICS)]

    parts = list(MarkerParams(120.0).narrowed())
    assert parts[0] == MarkerParams(120.0)
    assert [60, 60] not in centers(parts[0])
    part = next(part for part in parts if [60, 60] in centers(part))
    outline = next(m for m in find_markers(part, image, OPTICS) if m.center_px == pytest.approx([60, 60], abs=0.5))
    own = colors_of(MarkerParams(120.0), image, outline)
    assert centers(own) == [[60, 60]]
    assert own.min_saturation >= 0.5
    assert own.hue_tolerance_deg <= 35


def test_the_colours_of_a_marker_without_noise_have_a_tolerance():
    """Its lower half is a little paler in the next image."""
    image = drawn((60, 60, 12))
    (marker,) = find_markers(MarkerParams(), image, OPTICS)
    own = colors_of(MarkerParams(), image, marker)
    image[60:73, 45:76][image[60:73, 45:76, 1] == GREEN[1]] = (26, 220, 35)
    (shaded,) = find_markers(own, image, OPTICS)
    assert shaded.center_px == pytest.approx([60, 60], abs=0.2)


def test_what_sticks_out_of_a_marker_of_known_size_is_cut_off():
    image = drawn((60, 60, 12))
    image[57:64, 60:110] = GREEN
    (joined,) = find_markers(MarkerParams(), image, OPTICS)
    (marker,) = find_markers(MarkerParams(), image, OPTICS, near=(60, 60, 40), expected_area_px=452)
    assert joined.center_px[0] > 65
    assert marker.center_px == pytest.approx([60, 60], abs=1.0)
