"""The score of boxes: high where they hold the object, low where they do not, whichever tracker placed them."""

import cv2
import numpy as np
import pytest
from data import SEED

from pps_vision.geometry.masks import BoxPx
from pps_vision.types import Image
from tracking.track2d import ScoredTracker

N = 40


def spots(seed: int, height: int, width: int, low: int, high: int) -> Image:
    noise = np.random.default_rng((SEED, seed)).uniform(low, high, (height, width, 3))
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    return np.clip((smooth - smooth.mean()) * 4 + smooth.mean(), 0, 255).astype(np.uint8)


def box(k: int) -> BoxPx:
    return 20.0 + 5 * k, 80.0 + 20 * np.sin(k / 6), 40.0, 32.0


@pytest.fixture(scope="module")
def images() -> list[Image]:
    """A spotted object that moves before a spotted wall, turns slowly and grows darker."""
    wall, spotted = spots(1, 200, 280, 40, 220), spots(2, 32, 40, 90, 255)
    drawn = []
    for k in range(N):
        x, y, w, h = (round(side) for side in box(k))
        turned = cv2.getRotationMatrix2D((w / 2, h / 2), 0.4 * k, 1.0)
        content = cv2.warpAffine(spotted, turned, (w, h), borderMode=cv2.BORDER_REFLECT)
        image = wall.copy()
        image[y : y + h, x : x + w] = np.clip(content * np.array([1.0, 0.7, 0.4]) * (1 - 0.005 * k), 0, 255)
        drawn.append(image)
    return drawn


class Placed:
    """A tracker that returns the given boxes."""

    def __init__(self, boxes: list[BoxPx | None]) -> None:
        self.boxes = iter(boxes)

    def step(self, _: Image) -> BoxPx | None:
        return next(self.boxes)


def scores(images: list[Image], boxes: list[BoxPx | None]) -> np.ndarray:
    tracker = ScoredTracker(Placed(boxes), images[0], box(0))
    return np.array([tracker.step(image).score for image in images[1:]])


def test_a_box_on_the_object_scores_high_and_one_that_was_left_behind_low(images):
    follows = scores(images, [box(k) for k in range(1, N)])
    assert (follows >= 0.5).mean() >= 0.95
    stays = scores(images, [box(0)] * (N - 1))
    assert (stays[12:] < 0.4).all()
    jumps = scores(images, [box(k) if k < 20 else (200.0, 20.0, 40.0, 32.0) for k in range(1, N)])
    assert (jumps[:18] >= 0.5).all()
    assert (jumps[20:] < 0.4).all()


def test_a_box_that_is_none_scores_nothing_and_the_last_one_is_kept(images):
    tracker = ScoredTracker(Placed([box(1), None, (np.nan, 0.0, 1.0, 1.0)]), images[0], box(0))
    assert tracker.step(images[1]).box_px == box(1)
    assert tracker.step(images[2]) == (box(1), 0.0)
    assert tracker.step(images[3]).score == 0.0
