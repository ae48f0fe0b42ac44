"""The object in batches of images and in reduced images: its outlines against the truth, and the whole tracker against
frame by frame.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from ball_scenes import Sphere, frame
from data import SEED

from pps_vision.experiments.films.scenes import Film, FilmScene
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import home
from pps_vision.robot.model import Robot
from pps_vision.types import Status, StereoFrame
from tracking import batch
from tracking.appearance import ColorModel, color_bins, histogram
from tracking.batch import BatchTracker
from tracking.marker import MarkerParams, threshold
from tracking.outline import Optics
from tracking.tracker import Tracker, TrackerParams, TrackerStep

GREEN = (15.0, 200.0, 40.0)
BLUE = (30.0, 60.0, 210.0)
DEVICES = [torch.device(name) for name in ("cpu", *(["cuda"] if torch.cuda.is_available() else []))]
on_every_device = pytest.mark.parametrize("device", DEVICES, ids=str)


@on_every_device
def test_masks_are_those_of_frame_by_frame(device, rng):
    images = rng.integers(0, 256, (3, 40, 50, 3), dtype=np.uint8)
    everywhere = np.ones((20, 25), bool)
    model = ColorModel(*(histogram(rng.integers(0, 110, (20, 25), np.uint8), everywhere) for _ in range(2)))
    marker, generic = (
        batch.color_masks(appearance, torch.from_numpy(images).to(device)).cpu().numpy() > 0
        for appearance in (MarkerParams(hue_deg=350.0), model)
    )
    assert np.array_equal(marker, [threshold(MarkerParams(hue_deg=350.0), image) > 0 for image in images])
    smooth = np.array([cv2.GaussianBlur(model.table()[color_bins(image)], (3, 3), 0) for image in images])
    assert np.array_equal(generic[abs(smooth - 0.5) > 1e-5], (smooth > 0.5)[abs(smooth - 0.5) > 1e-5])
    assert 0.01 < marker.mean() < 0.99
    assert 0.01 < generic.mean() < 0.99


def _film(
    rig: StereoRig, robot: Robot, color: tuple[float, float, float], rng: np.random.Generator
) -> list[StereoFrame]:
    """A ball that circles, is gone for a second, and comes back; for three frames a second one of its colour shows."""
    q = home(robot)
    frames = []
    middle = rig.view(q).left.center + 0.4 * rig.view(q).left.rays([150.0, 120.0])
    for k in range(27):
        p = middle + 0.03 * np.array([0.2 * np.sin(0.5 * k), np.cos(0.5 * k), np.sin(0.5 * k)])
        spheres = [Sphere(p, 0.012, color)] if k < 14 or k > 18 else []
        if 8 <= k < 11:
            spheres.append(Sphere(middle + np.array([0.0, 0.08, 0.06]), 0.008, color))
        frames.append(frame(rig, q, spheres, 0.05 * k if k < 16 else 0.05 * k + 1.0, rng))
    return frames


def _steps(params: TrackerParams, rig: StereoRig, frames: list[StereoFrame], size: int) -> list[TrackerStep]:
    tracker = Tracker(params, rig, np.random.default_rng(0))
    if not size:
        return [tracker.step(stereo_frame) for stereo_frame in frames]
    batches = BatchTracker(tracker, DEVICES[0])
    return [step for k in range(0, len(frames), size) for step in batches.steps(frames[k : k + size])]


@pytest.mark.parametrize(("mode", "color"), [("marker", GREEN), ("generic", BLUE)])
def test_the_track_is_that_of_frame_by_frame_whatever_the_batch(mode, color, rig, robot, rng):
    """With different cameras: the right focal length is a fifth longer."""
    rig = replace(rig, right=replace(rig.right, fx=1.2 * rig.right.fx, fy=1.2 * rig.right.fy))
    params = TrackerParams(mode=mode)
    frames = _film(rig, robot, color, rng)
    alone, *batched = (_steps(params, rig, frames, size) for size in (0, 5, 64))
    is_known = [step.track.is_known for step in alone]
    assert sum(is_known) > 12
    assert not all(is_known[14:19])
    for steps in batched:
        assert [step.track.status for step in steps] == [step.track.status for step in alone]
        for alone_step, batch_step in zip(alone, steps, strict=True):
            assert len(alone_step.detections) == len(batch_step.detections)
            for a, b in zip(alone_step.detections, batch_step.detections, strict=True):
                assert np.linalg.norm(a.center_px - b.center_px) < 0.05
            if alone_step.track.is_known:  # without an observation the velocity's difference adds up
                limit_m = 2e-4 if alone_step.observation else 1e-3
                assert np.linalg.norm(alone_step.track.position - batch_step.track.position) < limit_m
                assert batch_step.track.radius_m == pytest.approx(alone_step.track.radius_m, rel=0.01)
    first, *remaining = ([step.track.mean for step in steps] for steps in batched)
    for means in remaining:
        assert np.allclose(means, first, rtol=0, atol=1e-7, equal_nan=True)


def test_a_lost_balls_colours_are_no_longer_searched(rig, robot, rng):
    q = home(robot)
    frames = _film(rig, robot, BLUE, rng)[:8]
    empty = [frame(rig, q, [], 0.05 * (8 + k), rng) for k in range(14)]
    tracker, marker = (Tracker(TrackerParams(mode), rig, np.random.default_rng(0)) for mode in ("generic", "marker"))
    for stereo_frame in frames:
        tracker.step(stereo_frame)
        marker.step(stereo_frame)
    assert tracker.appearance is not None
    statuses = [tracker.step(stereo_frame).track.status for stereo_frame in empty]
    assert Status.LOST in statuses
    assert tracker.appearance is None
    assert marker.appearance is not None  # a marker's hue is known all along


def test_images_of_another_size_are_left_to_the_search_frame_by_frame(rig):
    right, wrong = (np.zeros((rig.left.height - k, rig.left.width, 3), np.uint8) for k in (0, 1))
    assert batch.find(MarkerParams(), [right, wrong], Optics(rig.left), DEVICES[0]) == [None, None]
    assert batch.find(MarkerParams(), [right], Optics(rig.left), DEVICES[0]) == [[]]


@pytest.fixture(scope="module")
def film() -> Film:
    """A red ball on a circle, in images whose sides are no multiples of 4, before procedural textures."""
    scene = FilmScene(width=642, height=483, seconds=1.5, start="moving", background=2)
    return Film(scene, SEED, Path("no photographs"))


@cache
def track(film: Film, reduction: int) -> list[TrackerStep]:
    tracker = Tracker(TrackerParams(reduction=reduction), film.rig, np.random.default_rng(SEED))
    return [tracker.step(frame) for frame in film]


@pytest.mark.parametrize("reduction", [2, pytest.param(4, marks=pytest.mark.long)])
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
