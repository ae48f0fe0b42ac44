"""One eye, first box given: a drawn object that moves, grows, and comes near things of its colour."""

import cv2
import numpy as np
import pytest

from pps_vision.types import Image
from tracking.single import ColorTracker, ColorTrackerParams


def _scene(rng: np.random.Generator) -> Image:
    return cv2.resize(rng.integers(60, 150, (30, 40, 3), dtype=np.uint8), (640, 480), interpolation=cv2.INTER_CUBIC)


def _draw(scene: Image, center: tuple[float, float], radius: float, rng: np.random.Generator) -> Image:
    """An orange ball with a white patch, blurred and noisy."""
    image = scene.copy()
    at = (round(16 * center[0]), round(16 * center[1]))
    cv2.circle(image, at, round(16 * radius), (240, 120, 20), cv2.FILLED, cv2.LINE_AA, 4)
    cv2.circle(
        image, (at[0] + round(5 * radius), at[1]), round(4 * radius), (235, 230, 220), cv2.FILLED, cv2.LINE_AA, 4
    )
    image = cv2.GaussianBlur(image, (0, 0), 1.0).astype(float)
    return np.clip(image + 3 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)


def test_it_follows_a_ball_that_moves_and_grows(rng: np.random.Generator) -> None:
    scene = _scene(rng)
    tracker = ColorTracker(ColorTrackerParams(), rng)
    overlap = []
    for k in range(40):
        x, y, r = 200 + 150 * np.sin(0.12 * k), 230 + 80 * np.sin(0.2 * k), 18 + 0.4 * k
        image = _draw(scene, (x, y), r, rng)
        box = (x - r, y - r, 2 * r, 2 * r)
        found = tracker.start(image, box) if k == 0 else tracker.step(image)
        fx, fy, fw, fh = found.box_px
        w = max(min(fx + fw, x + r) - max(fx, x - r), 0)
        h = max(min(fy + fh, y + r) - max(fy, y - r), 0)
        overlap.append(w * h / (fw * fh + 4 * r * r - w * h))
    assert np.mean(overlap) > 0.85
    assert min(overlap) > 0.7


def test_an_object_that_vanishes_scores_nothing_and_is_found_again(rng: np.random.Generator) -> None:
    scene = _scene(rng)
    tracker = ColorTracker(ColorTrackerParams(), rng)
    tracker.start(_draw(scene, (200, 200), 20, rng), (180, 180, 40, 40))
    assert tracker.step(_draw(scene, (203, 200), 20, rng)).score > 0.8
    gone = tracker.step(np.clip(scene + 3 * rng.standard_normal(scene.shape), 0, 255).astype(np.uint8))
    assert gone.score == 0
    assert np.all(np.isfinite(gone.box_px))
    assert tracker.step(_draw(scene, (206, 200), 20, rng)).score > 0.8


def test_an_object_that_jumps_is_caught_again(rng: np.random.Generator) -> None:
    scene = _scene(rng)
    tracker = ColorTracker(ColorTrackerParams(), rng)
    tracker.start(_draw(scene, (200, 200), 20, rng), (180, 180, 40, 40))
    found = [tracker.step(_draw(scene, (270, 245), 20, rng)) for _ in range(3)][-1]
    assert found.score > 0.8
    assert np.linalg.norm([found.box_px[0] + 20 - 270, found.box_px[1] + 20 - 245]) < 4


def test_bad_use_is_named(rng: np.random.Generator) -> None:
    tracker = ColorTracker(ColorTrackerParams(), rng)
    image = np.zeros((48, 64, 3), np.uint8)
    with pytest.raises(ValueError, match="before start"):
        tracker.step(image)
    with pytest.raises(ValueError, match=r"60 5 10 10.*64×48"):
        tracker.start(image, (60, 5, 10, 10))
