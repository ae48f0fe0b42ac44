"""Real films of one camera, first box given: a red ball (VOT 2015 ball1), a pedestrian (OTB), a girl (SegTrack)."""

import numpy as np
import pytest
from data import shared_data

from pps_vision.app.evaluate_boxes import overlaps
from pps_vision.experiments.stages.image_tracker import REAL, BoxedFilm
from pps_vision.types import Array
from tracking.particle_filter import ParticleFilterParams
from tracking.track2d import MAX_SIMILARITY, BoxTracker, ColorTracker, CsrtTracker


def _overlaps(tracker: BoxTracker, film: BoxedFilm) -> Array:
    boxes = np.array([tracker.step(image).box_px for image in film.images[1:]])
    return np.diagonal(overlaps(boxes, np.array(film.boxes[1:])))


@pytest.mark.parametrize("seed", [0, 1])
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
    csrt = _overlaps(CsrtTracker(*start), film).mean()
    assert csrt >= 0.7
    assert _overlaps(colors, film).mean() < csrt - 0.05
