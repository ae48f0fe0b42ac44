"""One camera's tracker on drawn discs: prediction, detection and learning."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import LEFT_EYE
from pps_vision.types import Array, Image, Mask
from tracking.appearance import ColorModel
from tracking.camera_tracker import CameraState, CameraTracker
from tracking.image_tracker import ImageDetection, ImageTrackerParams
from tracking.kalman import Belief
from tracking.marker import MarkerParams
from tracking.outline import Optics, Outline
from tracking.particle_filter import Prior
from tracking.stereo import CameraFrame

OPTICS = Optics(LEFT_EYE)
VIEW = View(LEFT_EYE, np.eye(4))
BLUE = (30.0, 60.0, 210.0)
GREEN = (25.0, 200.0, 60.0)
BOX = (132.0, 92.0, 37.0, 37.0)
"""Of a disc of 18 px at (150, 110)."""
_V, _U = np.mgrid[:240, :320]


Part = tuple[Mask, tuple[float, float, float]]


def camera_tracker(rng: np.random.Generator, marker: MarkerParams | None = None) -> CameraTracker:
    return CameraTracker("left", OPTICS, ImageTrackerParams(), marker, 10.0, rng)


def disc(x: float, y: float, radius: float) -> Mask:
    return np.asarray(np.hypot(_U - x, _V - y) < radius)


def picture(rng: np.random.Generator, *parts: Part) -> Image:
    """A wall of soft grey spots with plain parts."""
    spots = np.random.default_rng(1).uniform(90, 140, (15, 20))
    image = cv2.resize(spots, (320, 240), interpolation=cv2.INTER_CUBIC)[..., None].repeat(3, axis=2)
    for mask, color in parts:
        image[mask] = color
    return np.clip(np.rint(image + 2 * rng.standard_normal(image.shape)), 0, 255).astype(np.uint8)


def seen_from(image: Image, view: View = VIEW, stamp_s: float = 1.0) -> CameraFrame:
    return CameraFrame(image, view, stamp_s, None)


def of_size(size_px: float, center_px: tuple[float, float] = (150.0, 110.0)) -> Outline:
    """The outline of a disc."""
    x, y = center_px
    box = (x - size_px / 2, y - size_px / 2, size_px, size_px)
    angle = 0.5 * size_px / LEFT_EYE.focal_px
    area = np.pi / 4 * size_px**2
    return Outline(np.array([x, y]), 0.01 * np.eye(2), angle, 1e-6, box, area, False)


def at(position: Array, stamp_s: float = 0.0, order: int = 2) -> Belief:
    mean = np.vstack([position, np.zeros((order - 1, 3))])
    return Belief(stamp_s, mean, 1e-8 * np.eye(3 * order), np.zeros((3, 3)), 0.0)


@pytest.mark.parametrize(
    ("before_m", "now_m", "growth"), [(0.44, 0.40, 1.1), (0.40, 0.44, 1 / 1.1), (0.60, 0.40, 1.25), (0.4, 0.6, 0.8)]
)
def test_what_comes_nearer_is_expected_to_grow(before_m, now_m, growth, rng):
    """The size follows the distance, by at most a quarter; the offset from the projected track is kept."""
    ray = np.array([0.1, -0.05, 1.0]) / np.linalg.norm([0.1, -0.05, 1.0])
    center = np.array([0.02, 0.0, 0.01])
    view = View(LEFT_EYE, transform(translation=center))
    state = CameraState(offset_px=(3.0, -2.0), size_px=30.0)
    for order in (1, 2):
        last, predicted = (at(center + distance_m * ray, order=order) for distance_m in (before_m, now_m))
        prior = camera_tracker(rng).predict(state, seen_from(picture(rng), view), last, predicted)
        assert prior.growth == pytest.approx(growth)
        np.testing.assert_allclose(prior.center_px, view.project(center + now_m * ray) + state.offset_px, atol=1e-6)


@pytest.mark.parametrize(
    ("std_m", "std_px"),
    [((0.02, 0.0), 10.0), ((0.0, 0.01), 5.0), ((0.03, 0.04), 25.0), ((0.001, 0.0), 0.7), ((0.1, 0.0), 40.0)],
)
def test_a_place_is_as_uncertain_as_the_track_across_the_line_of_sight(std_m, std_px, rng):
    """As many times 2 mm away as the focal length has pixels: 2 mm are a pixel; 0.7 px at least, 40 at most."""
    distance_m = 2 * 1e-3 * LEFT_EYE.focal_px
    cov = np.zeros((6, 6))
    cov[0, 0] = std_m[0] ** 2
    cov[1, 1] = std_m[1] ** 2
    cov[2, 2] = 1.0
    cov[3:, 3:] = np.eye(3)
    principal = VIEW.project(np.array([0.0, 0.0, distance_m]))
    belief = at(np.array([0.0, 0.0, distance_m]))._replace(cov=cov)
    prior = camera_tracker(rng).predict(CameraState(size_px=30.0), seen_from(picture(rng)), belief, belief)
    np.testing.assert_allclose(prior.center_px, principal)
    assert prior.std_px == pytest.approx(std_px, rel=0.02)
    assert prior.growth == 1.0


@pytest.mark.parametrize(("u", "is_seen"), [(-14.0, True), (-16.0, False), (333.0, True), (335.5, False)])
def test_an_object_is_in_view_if_a_part_of_it_is(u, is_seen, rng):
    """A disc of 30 px, at most half of it beyond the image's border; the border is at -0.5 and 319.5 px."""
    belief = at(0.4 * VIEW.rays([150.0, 110.0]))
    for offset in (u - 150.0, 0.0), (0.0, (u if u < 0 else u - 80) - 110.0):
        state = CameraState(offset_px=offset, size_px=30.0)
        prior = camera_tracker(rng).predict(state, seen_from(picture(rng)), belief, belief)
        assert (prior is not None) == is_seen


@pytest.mark.parametrize(
    ("off_px", "size_px", "is_it"),
    [
        *((off_px, 36.0, True) for off_px in ((0.0, 0.0), (25.0, 0.0), (0.0, -25.0))),
        *((off_px, 36.0, False) for off_px in ((27.0, 0.0), (0.0, -27.0))),
        ((0.0, 0.0), 36.7, True),
        *(((0.0, 0.0), size_px, False) for size_px in (37.4, 34.6)),
    ],
)
def test_an_outline_that_was_found_beforehand_is_near_and_as_large_as_expected(off_px, size_px, is_it, rng):
    """Its centre within the object's radius, two standard deviations and 4 px: 26 px; its size within 3 %."""
    tracker = camera_tracker(rng)
    outline = of_size(size_px, (150.0 + off_px[0], 110.0 + off_px[1]))
    camera = seen_from(picture(rng))._replace(outlines=[outline])
    state = CameraState(size_px=36.0)
    _, detection = tracker.find(state, camera, Prior(np.array([150.0, 110.0]), 2.0, 1.0))
    assert (detection is not None) == is_it
    _, detection = tracker.find(state._replace(size_px=30.0), camera, Prior(np.array([150.0, 110.0]), 3.5, 1.2))
    assert (detection is not None) == is_it
    if detection is not None:
        assert detection == ImageDetection(outline, outline.box_px, 1.0)
    _, detection = tracker.find(state._replace(by_background=True), camera, Prior(np.array([150.0, 110.0]), 2.0, 1.0))
    assert detection is None  # outlines are found by colours


def test_of_two_markers_the_nearer_one_is_followed_and_none_far_away(rng):
    """Within the object's size, four standard deviations and 3 px: 59 px."""
    tracker = camera_tracker(rng, MarkerParams())
    camera = seen_from(picture(rng, (disc(120, 110, 18), GREEN), (disc(185, 110, 18), GREEN)))
    state = CameraState(size_px=36.0)
    for x, expected in ((145.0, 120), (160.0, 185)):
        _, detection = tracker.find(state, camera, Prior(np.array([x, 110.0]), 3.0, 1.0))
        assert np.linalg.norm(detection.outline.center_px - [expected, 110]) < 0.1
    for x in (40.0, 120.0):
        again, detection = tracker.find(state, camera, Prior(np.array([x, 205.0]), 1.0, 1.0))
        assert detection is None
        assert again is state


@pytest.mark.parametrize(("share", "fits"), [(1.0, True), (1.09, True), (1.15, False), (0.67, True), (0.58, False)])
def test_a_marker_of_quite_another_area_is_not_it(share, fits, rng):
    """Up to a quarter more and down to two fifths; as predicted, a fifth larger than it was."""
    tracker = camera_tracker(rng, MarkerParams())
    camera = seen_from(picture(rng, (disc(150, 110, 21.6 * share), GREEN)))
    _, detection = tracker.find(CameraState(size_px=36.0), camera, Prior(np.array([150.0, 110.0]), 1.0, 1.2))
    assert (detection is not None) == fits
    assert not fits or detection.score == pytest.approx(min(share, 1 / share) ** 2, abs=0.03)


@pytest.mark.parametrize(("share", "tell_it"), [(0.0, True), (0.55, True), (0.7, False)])
def test_without_its_background_an_object_is_followed_by_its_colours_if_they_tell_it(share, tell_it, rng):
    """Of its surroundings a share has its colour; the Bhattacharyya coefficient is the root of that, 0.74 or 0.84."""
    tracker = camera_tracker(rng)
    camera = seen_from(picture(rng, (disc(150, 110, 18), BLUE)))
    target = tracker.image_tracker.start(camera.image, BOX, fill=np.pi / 4)
    own = target.model.object
    around = target.model.background
    target = replace(target, model=ColorModel(own, share * own + (1 - share) * around))
    state = CameraState(target, size_px=36.0, by_background=True)
    again, detection = tracker.find(state, camera, Prior(np.array([150.0, 110.0]), 1.0, 1.0))
    assert (detection is not None) == tell_it
    if tell_it:
        assert not again.by_background
    else:
        assert again is state


def learned(rng: np.random.Generator, *parts: Part) -> CameraTracker:
    """One that knows the wall with these parts, as an eye at rest sees it."""
    tracker = camera_tracker(rng)
    for k in range(12):
        tracker.background.update(picture(rng, *parts), VIEW, 0.05 * k, None)
    return tracker


def test_what_has_turned_abruptly_is_found_where_it_was(rng):
    """70 px from where it was expected, before a known background; not while something else touches it."""
    image = picture(rng, (disc(154, 112, 18), BLUE))
    prior = Prior(np.array([224.0, 110.0]), 1.0, 1.0)
    for tracker, touched, is_found in (
        (learned(rng), 0, True),
        (learned(rng), 3, False),
        (camera_tracker(rng), 0, False),
    ):
        target = tracker.image_tracker.start(picture(rng, (disc(150, 110, 18), BLUE)), BOX)
        state = CameraState(replace(target, touched=touched), size_px=36.0)
        _, detection = tracker.find(state, seen_from(image), prior)
        assert (detection is not None) == is_found
        if detection is not None:
            assert np.linalg.norm(detection.outline.center_px - [154, 112]) < 0.1


def test_an_object_of_the_walls_colour_is_told_by_the_background(rng):
    """A disc of two colours of which one is the wall's: by its colours a half of it would be left."""
    tracker = learned(rng)
    ball = disc(150, 110, 18)
    grey = (ball, (70.0, 70.0, 70.0)), (ball & (_U < 150), (165.0, 165.0, 165.0))
    target = tracker.image_tracker.start(picture(rng, *grey), BOX, fill=np.pi / 4)
    state = CameraState(target, size_px=36.0, by_background=True)
    again, detection = tracker.find(state, seen_from(picture(rng, *grey)), Prior(np.array([150.0, 110.0]), 1.0, 1.0))
    assert detection.outline.area_px == pytest.approx(np.pi * 18**2, rel=0.1)
    assert again.by_background


def test_an_outline_that_was_found_beforehand_moves_the_particles(rng):
    """To another place, and a size that they would take for another object's."""
    tracker = camera_tracker(rng)
    p = np.array([0.06, 0.03, 0.4])
    x, y = VIEW.project(p)
    image = picture(rng, (disc(150, 110, 18), BLUE))
    large = of_size(56.0, (x, y))
    camera = seen_from(image)._replace(outlines=[large])
    state = tracker.remember(CameraState(tracker.image_tracker.start(image, BOX)), camera, large, at(p))
    moved, result = tracker.find(state, camera, tracker.predict(state, camera, at(p), at(p)))
    assert result.outline is large
    assert moved.target.size == pytest.approx(56.0, rel=0.05)
    later = picture(rng, (disc(x, y, 28), BLUE))
    _, detection = tracker.image_tracker.step(moved.target, later, Prior(np.array([x, y]), 1.0, 1.0))
    assert np.linalg.norm(detection.outline.center_px - [x, y]) < 0.15
