"""The box tracker past its break: an object like its surroundings that is hidden, and one that never was there."""

from pathlib import Path

import numpy as np
import pytest

from pps_vision.experiments.baselines.image_trackers import intersection_over_union
from pps_vision.experiments.composites import Difficulty, composite
from tracking.box_tracker import LOST_SCORE, BoxTracker
from tracking.image_tracker import ImageTrackerParams


@pytest.mark.parametrize("difficulty", ["alike", "clutter", "occluded", "light"])
def test_where_the_box_is_off_the_score_is_low_and_most_boxes_are_on(difficulty: Difficulty) -> None:
    """Procedural textures; a tracker that always claims, or never finds, fails."""
    film = composite(difficulty, (0, 1, 2), Path("absent"), np.random.default_rng(8), n=60, shape=(180, 240))
    tracker = BoxTracker(ImageTrackerParams(), np.random.default_rng(0), "template")
    tracker.start(film.images[0], film.boxes[0])
    found = [tracker.step(image) for image in film.images[1:]]
    overlap = intersection_over_union(np.array([one.box_px for one in found]), np.array(film.boxes[1:]))
    score, visible = np.array([one.score for one in found]), film.visible[1:] > 0.5
    print(difficulty, f"IoU {overlap[visible].mean():.2f}", score[overlap < 0.1])
    assert overlap[visible].mean() > 0.6
    assert np.mean(score[(overlap >= 0.5) & visible] >= LOST_SCORE) >= 0.9
    assert np.sum((overlap < 0.1) & (score >= LOST_SCORE)) <= 0.05 * len(found)
