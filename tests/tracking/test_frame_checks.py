"""Eyes that show nothing, or nothing new."""

from itertools import product

import numpy as np
import pytest

from pps_vision.types import Image, StereoFrame
from tracking.frame_checks import fingerprints, is_blind


def picture(rng: np.random.Generator, contrast: float = 40.0) -> Image:
    return np.clip(120 + contrast * rng.standard_normal((48, 64, 3)), 0, 255).astype(np.uint8)


def blind(*pairs: tuple[Image, Image]) -> bool:
    """Whether the last of these pairs shows nothing, or nothing new."""
    last = None
    for left, right in pairs:
        previous = last
        last = fingerprints(StereoFrame(left, right, 0.0, 0.0))
    return is_blind(last, previous)


def test_one_repeated_picture_of_either_eye_is_blind_and_the_next_new_one_is_not(rng):
    first, second, third = ((picture(rng), picture(rng)) for _ in range(3))
    assert not blind(first)
    for repeated in ((first[0].copy(), second[1]), (second[0], first[1].copy())):
        assert blind(first, repeated)
        assert not blind(first, repeated, third)
    moved = (first[0][:, ::-1].copy(), first[1][:, ::-1].copy())  # the same pixels
    assert not blind(first, moved)


def test_a_buffer_that_is_filled_anew_is_not_blind(rng):
    images = np.stack([picture(rng), picture(rng)])
    last = fingerprints(StereoFrame(*images, 0.0, 0.0))
    images[:] = picture(rng), picture(rng)
    assert not is_blind(fingerprints(StereoFrame(*images, 0.1, 0.1)), last)


def test_a_dark_sensor_with_its_noise_is_blind_and_a_dim_picture_is_not(rng):
    """A white wall in the light is seen, under a camera of little noise, and something small before a plain ground."""
    dark = np.clip(np.rint(2.0 * rng.standard_normal((48, 64, 3))), 0, 255).astype(np.uint8)
    assert blind((picture(rng), dark))
    assert blind((np.full_like(dark, 255), picture(rng)))
    assert not blind((picture(rng), picture(rng, contrast=5.0)))
    for level in (40, 120, 230):
        wall = np.clip(np.rint(level + rng.standard_normal((48, 64, 3))), 0, 255).astype(np.uint8)
        assert not blind((wall, picture(rng)))
    for level, row in product((0, 90), range(0, 40, 4)):
        image = np.full((48, 64, 3), level, np.uint8)
        image[row : row + 8, 20:28] = (25, 200, 60)
        assert not blind((picture(rng), image))


@pytest.mark.parametrize("n", [10, 40])
def test_a_covered_sensor_with_hot_pixels_is_blind(rng, n):
    """Saturated ones, of which a colour camera's demosaicing raises the neighbours too."""
    dark = np.clip(np.rint(rng.standard_normal((240, 320, 3))), 0, 255).astype(np.uint8)
    grid = np.stack(np.meshgrid(np.arange(7, 230, 12), np.arange(7, 310, 12)), axis=-1).reshape(-1, 2)
    tent = np.array([[0.25, 0.5, 0.25], [0.5, 1, 0.5], [0.25, 0.5, 0.25]])
    for y, x in rng.choice(grid, n, replace=False):
        dark[y - 1 : y + 2, x - 1 : x + 2, rng.integers(3)] = 255 * tent
    assert dark.std(axis=(0, 1)).max() > 2.0
    assert blind((picture(rng), dark))
    dark[100:108, 100:108] = (25, 200, 60)  # something that is seen
    assert not blind((picture(rng), dark))


@pytest.mark.parametrize(
    ("rgb", "is_dark"), [((12, 12, 12), True), ((20, 20, 20), False), ((2, 2, 20), False), ((20, 2, 2), False)]
)
def test_black_has_less_than_sixteen_levels_in_each_channel(rgb, is_dark, rng):
    dim = np.clip(np.rint(rgb + rng.standard_normal((48, 64, 3))), 0, 255).astype(np.uint8)
    assert blind((picture(rng), dim)) == is_dark
