"""Tracking in reduced images, which are seen and reported in pixels of the images themselves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments.films.scenes import Film, FilmScene
from pps_vision.types import Status
from tracking.batch import BatchTracker
from tracking.tracker import Tracker, TrackerParams, TrackerStep


@pytest.fixture(scope="module")
def film() -> Film:
    """A red ball on a circle, in images whose sides are no multiples of 4, before procedural textures."""
    scene = FilmScene(width=642, height=483, seconds=1.5, start="moving", background=2)
    return Film(scene, SEED, Path("no photographs"))


def track(film: Film, reduction: int) -> list[TrackerStep]:
    tracker = Tracker(TrackerParams(reduction=reduction), film.rig, np.random.default_rng(SEED))
    return [tracker.step(frame) for frame in film]


@pytest.mark.parametrize("reduction", [2, 4])
def test_positions_and_pixels_are_those_of_the_whole_images(film, reduction):
    later = list(zip(track(film, reduction), film.truth, strict=True))[20:]
    assert all(step.track.status == Status.TRACKING for step, _ in later)
    offs_m = [np.linalg.norm(step.track.position - truth.position) for step, truth in later]
    assert np.median(offs_m) < 0.003 * reduction
    off_px = []
    for step, truth in later:
        for detection, true_px in zip(step.detections, (truth.left_px, truth.right_px), strict=True):
            off_px.append(detection.center_px - true_px)
            x, y, w, h = detection.box_px
            assert x < true_px[0] < x + w
            assert y < true_px[1] < y + h
            across_px = 2 * film.rig.left.focal_px * np.tan(detection.angular_radius_rad)
            assert across_px == pytest.approx(0.5 * (w + h), rel=0.25)
    assert np.sqrt(np.mean(np.square(off_px))) < 0.4 * reduction
    mean_px = np.mean(off_px, axis=0)
    assert np.abs(mean_px).max() < 0.2 * reduction  # corners taken for centres would be half of `reduction`


def test_batches_reduce_alike(film):
    import torch

    tracker = Tracker(TrackerParams(reduction=2), film.rig, np.random.default_rng(SEED))
    batched = BatchTracker(tracker, torch.device("cpu")).steps(list(film))
    for step, batched_step in list(zip(track(film, 2), batched, strict=True))[20:]:
        for detection, batched_detection in zip(step.detections, batched_step.detections, strict=True):
            assert np.abs(detection.center_px - batched_detection.center_px).max() < 0.1


def test_what_cannot_be_averaged_is_refused(film):
    with pytest.raises(ValueError, match="reduction 0; expected 1 or more"):
        TrackerParams(reduction=0)
    tracker = Tracker(TrackerParams(reduction=2), film.rig, np.random.default_rng(SEED))
    frame = next(iter(film))
    small = replace(frame, left=frame.left[::2, ::2])
    with pytest.raises(ValueError, match=r"left image \(242, 321, 3\).*expected \(483, 642, 3\)"):
        tracker.step(small)
