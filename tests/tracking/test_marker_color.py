"""The colour a marker was seen in, against colours that were painted."""

import cv2
import numpy as np
import pytest

from tracking.marker import MarkerParams
from tracking.marker_color import middle_of, narrowed

BOX_PX = 30.0, 20.0, 20.0, 20.0


def _painted(hue_deg: float, saturation: float, rng: np.random.Generator) -> np.ndarray:
    """A patch of one colour amid grey, noise 2/255."""
    hsv = np.array([[[hue_deg / 2, 255 * saturation, 200]]], dtype=np.uint8)
    image = np.full((60, 80, 3), 120.0)
    image[20:40, 30:50] = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0, 0]
    return np.clip(image + 2 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("hue_deg", [350.0, 4.0, 20.0])
def test_it_is_the_painted_colour_and_little_else(hue_deg: float, rng: np.random.Generator) -> None:
    """Across 0° too."""
    params = MarkerParams(hue_deg=0.0)
    own = narrowed(params, middle_of(_painted(hue_deg, 0.9, rng), BOX_PX))
    assert abs((own.hue_deg - hue_deg + 180) % 360 - 180) < 4
    assert 5 < own.hue_tolerance_deg < 16
    assert 0.65 < own.min_saturation < 0.85


def test_it_is_never_wider_than_what_was_asked_for(rng: np.random.Generator) -> None:
    params = MarkerParams(hue_deg=0.0, hue_tolerance_deg=6.0, min_saturation=0.7)
    own = narrowed(params, middle_of(_painted(4.0, 0.75, rng), BOX_PX))
    assert own.hue_tolerance_deg <= 6.0
    assert own.min_saturation == 0.7


def test_where_nothing_has_the_hue_nothing_changes(rng: np.random.Generator) -> None:
    params = MarkerParams(hue_deg=120.0)
    assert narrowed(params, middle_of(_painted(0.0, 0.9, rng), BOX_PX)) == params


def test_an_image_that_is_filled_anew_changes_nothing_that_was_seen(rng: np.random.Generator) -> None:
    image = _painted(120.0, 0.9, rng)
    middle = middle_of(image, BOX_PX)
    image[:] = 0
    assert middle.min(axis=(0, 1)).max() > 150


def test_of_less_than_four_pixels_no_colour_is_taken() -> None:
    middle, params = np.full((6, 6, 3), 120, np.uint8), MarkerParams(hue_deg=120.0)
    for n in range(6):
        assert (narrowed(params, middle) == params) == (n < 4)
        middle[n, n] = 20, 200, 20
