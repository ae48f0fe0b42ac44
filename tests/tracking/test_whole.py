"""Of an object of several stripes of one colour the whole is followed, though one stripe was found first."""

from pathlib import Path

import numpy as np

from pps_vision.experiments.independent_films import Film, IndependentScene
from pps_vision.types import Status
from tracking.tracker import Tracker, TrackerParams


def test_the_whole_of_a_stripe_is_followed_once_the_background_of_moving_eyes_is_known(tmp_path: Path) -> None:
    scene = IndependentScene(
        **{"width": 320, "height": 240, "rig": "head", "background": 4, "seconds": 2.0},
        **{"pattern": "striped", "radius_m": 0.04, "distance_m": 0.43},
        **{"start": "moving", "motion": "reversal", "speed_m_s": 0.15},
    )
    film = Film(scene, 12, tmp_path)
    tracker = Tracker(TrackerParams(), film.rig, np.random.default_rng(0))
    tracks = [tracker.step(frame).track for frame in film]
    first = next(track for track in tracks if track.status is Status.TRACKING)
    assert first.radius_m < 0.5 * scene.radius_m, "one stripe"
    for track, truth in zip(tracks, film.truths[0], strict=True):
        if truth.stamp_s > 1.5:
            assert track.status is Status.TRACKING
            assert abs(track.radius_m / scene.radius_m - 1) < 0.05
            assert np.linalg.norm(track.position - truth.position) < 0.01
