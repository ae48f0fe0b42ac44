"""A ball that leaves the view and returns, as half of it is still seen or after the view was empty."""

import numpy as np
import pytest

from pps_vision.experiments.films.recordings import tracker_params
from pps_vision.experiments.severity.tracking import leave_view
from tracking.tracker import Tracker

OUT_S = 2.0
NEAR_M = 0.06


@pytest.mark.parametrize(
    ("mode", "seed", "within_s"),
    [
        ("generic", 7201, 0.1),  # half of it stays in view: its size is not that of the half
        ("generic", 7202, 0.15),
        ("marker", 7201, 0.5),  # before pictures with much of its hue
        ("marker", 7205, 0.2),
    ],
)
def test_it_is_found_again_soon_after_its_centre_is_back_in_view(mode, seed, within_s):
    film = leave_view("independent", seed, OUT_S)
    tracker = Tracker(tracker_params(film, mode), film.rig, np.random.default_rng(seed), own_body=film.own_body)
    tracks = [tracker.step(frame).track for frame in film.frames]
    back_s = film.stamps_s[np.flatnonzero(~film.visible)[-1] + 1]
    near = np.array(
        [np.linalg.norm(track.position - at) < NEAR_M for track, at in zip(tracks, film.position, strict=True)]
    )
    assert near[film.stamps_s > back_s + within_s].all()
