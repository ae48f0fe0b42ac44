"""Real films of one camera, first box given: a red ball (VOT 2015 ball1), a pedestrian (OTB), a girl (SegTrack)."""

import numpy as np
import pytest
from data import shared_data

from pps_vision.app.evaluate_boxes import overlaps
from pps_vision.experiments.stages.image_tracker import REAL, BoxedFilm
from pps_vision.types import Array
from tracking.particle_filter import ParticleFilterParams
from tracking.track2d import MAX_SIMILARITY, BoxTracker, ColorTracker, ScoredTracker, csrt_tracker


def _overlaps(tracker: BoxTracker, film: BoxedFilm) -> Array:
    boxes = np.array([tracker.step(image) or [np.nan] * 4 for image in film.images[1:]])
    return np.nan_to_num(np.diagonal(overlaps(boxes, np.array(film.boxes[1:]))))


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_colours_follow_the_ball_over_the_whole_film(seed):
    film = REAL["vot_ball1"](shared_data("vot_ball1"))
    tracker = ColorTracker(film.images[0], film.boxes[0], ParticleFilterParams(), np.random.default_rng(seed))
    assert tracker.similarity < MAX_SIMILARITY
    overlaps = _overlaps(tracker, film)
    print(f"mean IoU {overlaps.mean():.3f}")
    assert overlaps.mean() >= 0.8  # what is partly hidden has the box of the particles, which is that of the whole ball
    assert overlaps.min() > 0.5


@pytest.mark.parametrize("name", ["otb_crossing", "segtrack2_girl"])
def test_csrt_follows_a_person_whose_colours_are_those_of_the_street(name):
    """The particle filter does it less well, and its similarity says so beforehand."""
    film = REAL[name](shared_data(name))
    start = film.images[0], film.boxes[0]
    colors = ColorTracker(*start, ParticleFilterParams(), np.random.default_rng(0))
    assert colors.similarity > MAX_SIMILARITY
    csrt = _overlaps(csrt_tracker(*start), film).mean()
    assert csrt >= 0.7
    assert _overlaps(colors, film).mean() < csrt - 0.05


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (name == "vot_ball1")) for name in REAL]
)
def test_the_score_says_whether_csrt_has_lost_the_object(name):
    """Started on the object, or put onto the background at the farther side of the image after a third of the film."""
    film = REAL[name](shared_data(name))
    first, n = film.images[0], len(film.images) // 3
    tracker = ScoredTracker(csrt_tracker(first, film.boxes[0]), first, film.boxes[0])
    followed = [tracker.step(image) for image in film.images[1:n]]
    assert np.mean([detection.score >= 0.5 for detection in followed]) >= 0.8
    x, y, w, h = film.boxes[n]
    width = film.images[0].shape[1]
    beside = (0.0 if x > 0.5 * (width - w) else width - w - 1, y, w, h)
    tracker = ScoredTracker(csrt_tracker(film.images[n], beside), first, film.boxes[0])
    placed = [tracker.step(image) for image in film.images[n + 1 : 2 * n]]
    iou = np.diagonal(overlaps(np.array([d.box_px for d in placed]), np.array(film.boxes[n + 1 : 2 * n])))
    lost = np.array([d.score for d in placed])[iou < 0.1]
    assert len(lost)
    assert np.mean(lost < 0.4) >= 0.9
