"""The image tracker of one camera: detections and rejections."""

from functools import partial

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import View
from pps_vision.robot.icub import LEFT_EYE
from tracking.acquisition import segment
from tracking.camera_tracker import CameraState, CameraTracker
from tracking.image_tracker import (
    ImageDetection,
    ImageTracker,
    ImageTrackerParams,
)
from tracking.kalman import Belief
from tracking.motion_trigger import Region2D
from tracking.outline import Optics, Outline
from tracking.particle_filter import Prior
from tracking.stereo import CameraFrame

BLUE = (30.0, 60.0, 210.0)
RED = (200.0, 40.0, 40.0)


def _discs(rng: np.random.Generator, *discs: tuple[float, float, float], bar: bool = False) -> np.ndarray:
    """Blue discs (x, y, radius px) amid grey noise, with a bar of their colour to the right of the first."""
    v, u = np.mgrid[: LEFT_EYE.height, : LEFT_EYE.width]
    image = np.full((LEFT_EYE.height, LEFT_EYE.width, 3), 120.0)
    for x, y, radius in discs:
        image[np.hypot(u - x, v - y) < radius] = BLUE
    if bar:
        x, y, _ = discs[0]
        image[(abs(v - y) < 3.5) & (u > x) & (u < x + 70)] = BLUE
    return np.clip(image + 2 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)


def _seen(rng: np.random.Generator, image: np.ndarray, prior: Prior) -> ImageDetection | None:
    """In an image, by a tracker that knows a disc of 18 px at (150, 110)."""
    eye = ImageTracker(ImageTrackerParams(), Optics(LEFT_EYE), rng)
    return eye.step(eye.start(_discs(rng, (150, 110, 18)), (132.0, 92.0, 37.0, 37.0)), image, prior)[1]


def test_what_is_of_quite_another_size_is_not_it(rng):
    """Four fifths of its radius pass, for two thirds of the score; half the radius, a quarter of the area, does not."""
    prior = Prior(np.array([150.0, 110.0]), 3.0, 1.0)
    smaller = _seen(rng, _discs(rng, (150, 110, 0.8 * 18)), prior)
    assert abs(smaller.score - 0.64) < 0.1
    assert _seen(rng, _discs(rng, (150, 110, 0.7 * 18)), prior) is not None
    assert _seen(rng, _discs(rng, (150, 110, 0.5 * 18)), prior) is None


def test_two_alike_that_touch_are_told_apart_by_their_edge_and_the_prediction(rng):
    """Before a known background: a disc of 18 px at its predicted place, which another passes; the other is not it."""
    eye = ImageTracker(ImageTrackerParams(), Optics(LEFT_EYE), rng)
    target = eye.start(_discs(rng, (150, 110, 18)), (132.0, 92.0, 37.0, 37.0))
    prior = Prior(np.array([152.3, 110.8]), 0.7, 1.0)
    result = []
    for apart in (34, 26, 18, -18, -26, -34):
        image = _discs(rng, (152, 111, 18), (152 + apart, 111, 16))
        target, detection = eye.step(target, image, prior, partial(_is_blue, image))
        assert target.touched
        result += [] if detection is None else [detection.outline.center_px]
    assert len(result) >= 4
    assert np.abs(np.array(result) - [152, 111]).max() < 0.7
    hidden = _discs(rng, (158, 111, 16))
    assert eye.step(target, hidden, prior, partial(_is_blue, hidden))[1] is None
    alone = _discs(rng, (152, 111, 18))
    touched = []  # number of images for which the other disc may still hide it
    for _ in range(6):
        target, detection = eye.step(target, alone, prior, partial(_is_blue, alone))
        assert detection is not None
        touched.append(target.touched)
    assert touched == [4, 3, 2, 1, 0, 0]


def _is_blue(image: np.ndarray, box: tuple[int, int, int, int]) -> np.ndarray:
    return np.asarray(image[box[1] : box[3], box[0] : box[2], 0] < 75)


@pytest.mark.parametrize("edge", ["straight", "ragged"])
def test_what_is_hidden_in_part_keeps_its_size(edge, rng):
    """A disc of 18 px goes behind an edge, by 4 px an image; behind a ragged edge no disc is fitted."""
    eye = ImageTracker(ImageTrackerParams(), Optics(LEFT_EYE), rng)
    target = eye.start(_discs(rng, (150, 110, 18)), (132.0, 92.0, 37.0, 37.0))
    initial = target.size
    partial_views = 0
    v, u = np.mgrid[: LEFT_EYE.height, : LEFT_EYE.width]
    for k in range(1, 6):
        x = 150 + 4 * k
        image = _discs(rng, (x, 110, 18))
        image[u >= 168 + (8 * np.sin(v / 2) if edge == "ragged" else 0)] = 120
        target, detection = eye.step(
            target, image, Prior(np.array([float(x), 110.0]), 1.0, 1.0), partial(_is_blue, image)
        )
        partial_views += detection.outline.is_partial
    assert partial_views >= 3
    assert abs(target.size / initial - 1) < 0.07


def test_a_thin_thing_of_its_colour_that_touches_it_is_no_part_of_it(rng):
    detection = _seen(rng, _discs(rng, (150, 110, 18), bar=True), Prior(np.array([150.0, 110.0]), 3.0, 1.0))
    assert np.linalg.norm(detection.outline.center_px - [150, 110]) < 0.5
    assert abs(detection.outline.area_px / (np.pi * 18**2) - 1) < 0.03


def test_outside_the_image_nothing_is_searched(rng):
    image = _discs(rng, (150, 110, 18))
    for center in ((150.0, 400.0), (150.0, -200.0), (500.0, 110.0), (-200.0, 110.0)):
        for std_px in (3.0, 30.0):
            assert _seen(rng, image, Prior(np.array(center), std_px, 1.0)) is None


def test_where_nothing_has_its_colour_it_is_not_seen(rng):
    """Its state is kept; the particles stay around the predicted position."""
    eye = ImageTracker(ImageTrackerParams(), Optics(LEFT_EYE), rng)
    target = eye.start(_discs(rng, (150, 110, 18)), (132.0, 92.0, 37.0, 37.0))
    after, detection = eye.step(target, _discs(rng), Prior(np.array([160.0, 115.0]), 1.0, 1.0))
    assert detection is None
    assert after.model is target.model
    assert (after.size, after.shape, after.fill, after.touched) == (target.size, target.shape, target.fill, 0)
    np.testing.assert_allclose(after.particles.current[:, :2].mean(axis=0), [160, 115], atol=2)


def test_fewer_than_two_particles_are_refused():
    with pytest.raises(ValueError, match="1 particles"):
        ImageTrackerParams(particles=1)
    assert ImageTrackerParams(particles=2).particles == 2


def _is_no_grey(image: np.ndarray, box: tuple[int, int, int, int]) -> np.ndarray:
    return np.asarray(np.ptp(image[box[1] : box[3], box[0] : box[2]].astype(int), axis=2) > 60)


def test_by_the_background_alone_an_object_may_take_any_colour(rng):
    """A disc that has turned from blue to red: its colours do not show it."""
    eye = ImageTracker(ImageTrackerParams(), Optics(LEFT_EYE), rng)
    target = eye.start(_discs(rng, (150, 110, 18)), (132.0, 92.0, 37.0, 37.0))
    prior = Prior(np.array([152.0, 111.0]), 1, 1)
    image = _discs(rng, (152, 111, 18))
    image[image[..., 0] < 75] = (200, 40, 40)
    assert eye.step(target, image, prior, partial(_is_no_grey, image))[1] is None
    _, detection = eye.step(target, image, prior, partial(_is_no_grey, image), by_color=False)
    assert np.linalg.norm(detection.outline.center_px - [152, 111]) < 0.5
    assert detection.score > 0.9


def test_what_colours_join_is_searched_once_more_in_what_differs_from_the_background(rng):
    """A blue disc before a blue wall's edge: colours show both, the foreground shows the disc alone."""
    eye = ImageTracker(ImageTrackerParams(), Optics(LEFT_EYE), rng)
    joined = _discs(rng)
    requested_boxes = []
    joined[:, 165:260] = BLUE
    v, u = np.mgrid[:240, :320]
    disc = np.hypot(u - 150, v - 110) < 18
    joined[disc] = BLUE
    target = eye.start(_discs(rng, (150, 110, 18)), (132.0, 92.0, 37.0, 37.0))
    prior = Prior(np.array([150.0, 110.0]), 1, 1)

    def differs(box: tuple[int, int, int, int]) -> np.ndarray:
        requested_boxes.append(box)
        return np.asarray(disc[box[1] : box[3], box[0] : box[2]])

    _, detection = eye.step(target, joined, prior, if_joined=differs)
    assert requested_boxes
    assert np.linalg.norm(detection.outline.center_px - [150, 110]) < 0.5
    requested_boxes.clear()
    _, detection = eye.step(target, _discs(rng, (150, 110, 18)), prior, if_joined=differs)
    assert detection is not None
    assert not requested_boxes  # nothing is joined


def test_a_long_object_is_followed_over_its_whole_length(rng):
    images = [np.full((LEFT_EYE.height, LEFT_EYE.width, 3), 120, np.uint8) for _ in range(2)]
    for image, x in zip(images, (100, 106), strict=True):
        image[105:115, x : x + 80] = BLUE
    eye = ImageTracker(ImageTrackerParams(), Optics(LEFT_EYE), rng)
    _, detection = eye.step(
        eye.start(images[0], (100, 105, 80, 10)), images[1], Prior(np.array([145.5, 109.5]), 2.0, 1.0)
    )
    np.testing.assert_allclose(detection.outline.box_px, (106, 105, 80, 10), atol=1)


def _moved_at(box: tuple[int, int, int, int]) -> Region2D:
    return Region2D(box, np.ones((box[3], box[2]), bool), 1.0)


def test_where_an_object_has_the_colours_of_what_is_around_none_is_taken_up(rng):
    """Blue among specks: as many as in the disc, half as many, or none."""
    v, u = np.mgrid[: LEFT_EYE.height, : LEFT_EYE.width]
    disc = np.hypot(u - 150, v - 110) < 15
    optics = Optics(LEFT_EYE)
    taken = []
    for around in (0.0, 0.25, 0.6):
        blue = rng.random(disc.shape) < np.where(disc, 0.9, around)
        image = np.where(blue[..., None], BLUE, RED).astype(np.uint8)
        taken.append(segment(image, _moved_at((138, 98, 25, 25)), optics) is not None)
    assert taken == [True, True, False]


def test_an_outline_that_was_found_beforehand_moves_the_particles(rng):
    """To another place, and a size that they would take for another object's."""
    view = View(LEFT_EYE, np.eye(4))
    p = np.array([0.06, 0.03, 0.4])
    image = _discs(rng, (150, 110, 18))
    x, y = view.project(p)
    tracker = CameraTracker("left", Optics(LEFT_EYE), ImageTrackerParams(), None, 0.3, rng)
    belief = Belief(0.0, np.array([p, np.zeros(3)]), 1e-8 * np.eye(6), np.zeros((3, 3)), 0.0)
    box = (x - 28, y - 28, 56.0, 56.0)
    large = Outline(np.array([x, y]), 0.01 * np.eye(2), 28 / LEFT_EYE.focal_px, 1e-6, box, np.pi * 28**2, False)
    state = CameraState(tracker.image_tracker.start(image, (132.0, 92.0, 37.0, 37.0)))
    camera = CameraFrame(image, view, 0.0, None, [large])
    state = tracker.remember(state, camera, large, belief)
    moved, result = tracker.find(state, camera, tracker.predict(state, camera, belief, belief))
    assert result.outline is large
    assert moved.target is not None
    _, detection = tracker.image_tracker.step(moved.target, _discs(rng, (x, y, 28)), Prior(np.array([x, y]), 1.0, 1.0))
    assert np.linalg.norm(detection.outline.center_px - [x, y]) < 0.3


def test_what_shows_in_an_objects_place_can_be_taken_for_background(rng):
    """A disc was there when the background was learned, and has left; another place that has changed stays changed."""
    view = View(LEFT_EYE, np.eye(4))
    empty = _discs(rng)
    tracker = CameraTracker("left", Optics(LEFT_EYE), ImageTrackerParams(), None, 0.3, rng)
    for k in range(12):
        tracker.background.update(_discs(rng, (150, 110, 18), (60, 60, 12)), view, 0.05 * k, None)
    outline = Outline(np.array([150.0, 110.0]), 0.01 * np.eye(2), 0.08, 1e-6, (132.0, 92.0, 37.0, 37.0), 1000.0, False)
    near_outline = (135, 95, 166, 126)
    distant_box = (55, 55, 66, 66)
    assert tracker.background.differs(empty, view, near_outline).mean() > 0.8
    tracker.set_from(CameraFrame(empty, view, 1.0, None), ImageDetection(outline, outline.box_px, 1.0))
    assert tracker.background.differs(empty, view, near_outline).mean() < 0.01
    assert tracker.background.differs(empty, view, (0, 0, 320, 240))[90:131, 130:171].mean() < 0.02
    assert tracker.background.differs(empty, view, distant_box).mean() > 0.8


def _before_spots(rng: np.random.Generator, disc: bool) -> np.ndarray:
    """A wall of soft spots, and a plain disc of 18 px at (150, 110) before it."""
    wall = cv2.resize(np.random.default_rng(1).uniform(60, 160, (15, 20, 3)), (320, 240), interpolation=cv2.INTER_CUBIC)
    if disc:
        v, u = np.mgrid[:240, :320]
        wall[np.hypot(u - 150, v - 110) < 18] = (190.0, 40.0, 40.0)
    return np.clip(np.rint(wall + 2 * rng.standard_normal(wall.shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("was_learned", [True, False])
def test_what_is_followed_before_the_background_is_empty_where_its_edge_is_the_backgrounds(was_learned, rng):
    """A disc was there when the background was learned, and has left; or it has come, and is no empty place.

    Evidence adds up while the place rests.
    """
    view = View(LEFT_EYE, np.eye(4))
    current = _before_spots(rng, not was_learned)
    tracker = CameraTracker("left", Optics(LEFT_EYE), ImageTrackerParams(), None, 10.0, rng)
    for k in range(12):
        tracker.background.update(_before_spots(rng, was_learned), view, 0.05 * k, None)
    target = tracker.image_tracker.start(current, (132.0, 92.0, 37.0, 37.0), fill=np.pi / 4)
    state = CameraState(target, size_px=36.0, by_background=True)
    prior = Prior(np.array([150.0, 110.0]), 1.0, 1.0)
    evidence = []
    for k in range(12, 16):
        camera = CameraFrame(_before_spots(rng, not was_learned), view, 0.05 * k, None)
        state, result = tracker.find(state, camera, prior)
        assert np.linalg.norm(result.outline.center_px - [150, 110]) < 2
        evidence.append(state.ghost_score)
    assert state.is_ghost == was_learned
    steps = np.diff([0.0, *evidence])
    np.testing.assert_allclose(steps, 0.4 if was_learned else -0.6, atol=0.05)  # all of the edge, or none, less 0.6
    for k in range(16, 40):
        state, _ = tracker.find(state, camera._replace(stamp_s=0.05 * k), prior)
    assert state.ghost_score >= -3  # so that a thing that leaves later can still be noticed
