"""Real films of one camera, first box given: a red ball (VOT 2015 ball1), a pedestrian (OTB), a girl (SegTrack)."""

import numpy as np
import pytest
from data import shared_data

from pps_vision.experiments.baselines.image_trackers import intersection_over_union
from pps_vision.recordings.video import open_frames
from pps_vision.types import Array, Image
from tracking.image_tracker import ImageTrackerParams
from tracking.track2d import MAX_SIMILARITY, BoxTracker, ColorTracker, CsrtTracker


def _upright(polygons: Array) -> Array:
    """(n, 4) axis-aligned boxes x, y, w, h around polygons (n, 4, 2)."""
    low = polygons.min(axis=1)
    high = polygons.max(axis=1)
    return np.hstack([low, high - low])


def _ball() -> tuple[list[Image], Array]:
    corners = np.loadtxt(shared_data("vot_ball1", "groundtruth.txt"), delimiter=",")
    return _images("vot_ball1", "frames"), _upright(corners.reshape(-1, 4, 2))


def _pedestrian() -> tuple[list[Image], Array]:
    boxes = np.loadtxt(shared_data("otb_crossing", "groundtruth_rect.txt"))
    return _images("otb_crossing", "img"), boxes - [1, 1, 0, 0]  # MATLAB's first pixel is 1


def _girl() -> tuple[list[Image], Array]:
    return _images("segtrack2_girl", "img"), np.loadtxt(shared_data("segtrack2_girl", "groundtruth.txt"), delimiter=",")


def _images(folder: str, frames: str) -> list[Image]:
    return [image for _, image in open_frames(shared_data(folder, frames))]


def _overlaps(tracker: BoxTracker, images: list[Image], truth: Array) -> Array:
    boxes = np.array([tracker.step(image).box_px for image in images[1:]])
    return intersection_over_union(boxes, truth[1:])


@pytest.mark.parametrize("seed", [0, 1])
def test_colours_follow_the_ball_over_the_whole_film(seed):
    images, truth = _ball()
    tracker = ColorTracker(images[0], tuple(truth[0]), ImageTrackerParams(), np.random.default_rng(seed))
    assert tracker.similarity < MAX_SIMILARITY
    overlaps = _overlaps(tracker, images, truth)
    print(f"mean IoU {overlaps.mean():.3f}")
    assert overlaps.mean() >= 0.83
    assert overlaps.min() > 0.5


@pytest.mark.parametrize("film", [_pedestrian, _girl])
def test_csrt_follows_a_person_whose_colours_are_those_of_the_street(film):
    """The particle filter does not, and its similarity says so beforehand."""
    images, truth = film()
    first = tuple(truth[0])
    colors = ColorTracker(images[0], first, ImageTrackerParams(), np.random.default_rng(0))
    assert colors.similarity > MAX_SIMILARITY
    assert _overlaps(colors, images, truth).mean() < 0.5
    assert _overlaps(CsrtTracker(images[0], first), images, truth).mean() >= 0.7
