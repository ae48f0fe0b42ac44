"""One camera's tracker on drawn discs: prediction, detection and learning."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import View
from pps_vision.robot.icub import LEFT_EYE
from pps_vision.types import Array, Image, Mask
from tracking.appearance import ColorModel
from tracking.foreground import ForegroundParams
from tracking.image_tracker import CameraState, CameraTracker, Prior
from tracking.kalman import Belief
from tracking.marker import MarkerParams
from tracking.outline import Optics
from tracking.particle_filter import Located
from tracking.stereo import CameraFrame

OPTICS = Optics(LEFT_EYE)
VIEW = View(LEFT_EYE, np.eye(4))
BLUE = (30.0, 60.0, 210.0)
GREEN = (25.0, 200.0, 60.0)
_V, _U = np.mgrid[:240, :320]
Part = tuple[Mask, tuple[float, float, float]]


def camera_tracker(marker: MarkerParams | None = None) -> CameraTracker:
    return CameraTracker("left", OPTICS, marker, ForegroundParams(memory_s=0.2))


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


def at(position: Array, velocity: Array | None = None) -> Belief:
    mean = np.array([position, np.zeros(3) if velocity is None else velocity])
    return Belief(0.0, mean, 1e-8 * np.eye(6), np.zeros((3, 3)), 0.0)


def prior_at(x: float, y: float, std_px: float = 1.0, size_px: float = 36.0, distance_m: float = 0.4) -> Prior:
    return Prior(np.array([x, y]), std_px, distance_m, 0.5 * size_px / LEFT_EYE.focal_px, size_px)


def known(tracker: CameraTracker, image: Image, by_background: bool = False) -> CameraState:
    """The state of a tracker that knows a disc of 18 px at (150, 110)."""
    target = tracker.image_tracker.start(image, (132.0, 92.0, 37.0, 37.0), 18 / LEFT_EYE.focal_px)
    return CameraState(target, by_background=by_background)


@pytest.mark.parametrize(("u", "is_seen"), [(-14.0, True), (-16.0, False), (333.0, True), (335.5, False)])
def test_an_object_is_in_view_if_a_part_of_it_is(u, is_seen, rng):
    """A disc of 30 px, at most half of it beyond the image's border; the border is at -0.5 and 319.5 px."""
    belief = at(0.4 * VIEW.rays([150.0, 110.0]))
    radius_m = 0.4 * np.sin(15 / LEFT_EYE.focal_px)
    for offset in (u - 150.0, 0.0), (0.0, (u if u < 0 else u - 80) - 110.0):
        state = CameraState(offset_px=offset)
        prior = camera_tracker().predict(state, seen_from(picture(rng)), belief, belief.cov[:3, :3], radius_m)
        assert (prior is not None) == is_seen


def test_of_two_markers_the_nearer_one_is_followed_and_none_far_away(rng):
    """Within the object's size, four standard deviations and 3 px: 59 px."""
    tracker = camera_tracker(MarkerParams())
    camera = seen_from(picture(rng, (disc(120, 110, 18), GREEN), (disc(185, 110, 18), GREEN)))
    for x, expected in ((145.0, 120), (160.0, 185)):
        _, detection, _ = tracker.quick(CameraState(), camera, prior_at(x, 110, 3.0))
        assert np.linalg.norm(detection.outline.center_px - [expected, 110]) < 0.1
    for x in (40.0, 120.0):
        assert tracker.quick(CameraState(), camera, prior_at(x, 205))[1:] == (None, False)


@pytest.mark.parametrize(("share", "tell_it"), [(0.0, True), (0.55, True), (0.7, False)])
def test_without_its_background_an_object_is_followed_by_its_colours_if_they_tell_it(share, tell_it, rng):
    """Of its surroundings a share has its colour; the Bhattacharyya coefficient is the root of that, 0.74 or 0.84."""
    tracker = camera_tracker()
    camera = seen_from(picture(rng, (disc(150, 110, 18), BLUE)))
    state = known(tracker, camera.image, by_background=True)
    own = state.target.model.object
    around = state.target.model.background
    mixed = replace(state.target, model=ColorModel(own, share * own + (1 - share) * around))
    state, examined = tracker.examine(state._replace(target=mixed), camera, prior_at(150, 110))
    assert (examined is not None, state.by_background) == (tell_it, not tell_it)


@pytest.mark.parametrize(("off_px", "is_it"), [(0.0, True), (4.5, True), (5.5, False)])
def test_an_object_of_the_walls_colour_is_told_by_the_background(off_px, is_it, rng):
    """A disc of two colours of which one is the wall's, before the wall that an eye at rest has learned; within three
    standard deviations of its prediction and a twentieth of its size."""
    tracker = camera_tracker()
    for k in range(12):
        tracker.background.update(picture(rng), VIEW, 0.05 * k)
    ball = disc(150, 110, 18)
    camera = seen_from(picture(rng, (ball, (70.0, 70.0, 70.0)), (ball & (_U < 150), (165.0, 165.0, 165.0))))
    state, examined = tracker.examine(known(tracker, camera.image, True), camera, prior_at(150 + off_px, 110))
    whole = tracker.whole(state, camera, examined, prior_at(150 + off_px, 110))
    assert (whole is not None) == is_it
    if whole is not None:
        assert whole[1].outline.area_px == pytest.approx(np.pi * 18**2, rel=0.1)
        assert whole[0].by_background


@pytest.mark.parametrize(("fill", "marker"), [((0.5, 0.6), None), ((0.5, 0.2), None), ((0.5, 0.6), MarkerParams())])
def test_what_is_hidden_in_part_is_located_by_its_visible_edge_if_enough_of_it_shows(fill, marker, rng):
    """In both eyes; a marker's hue does not tell it from what hides it.  The particles are 2 px off."""
    tracker = camera_tracker(marker)
    image = picture(
        rng, (disc(150, 110, 18) & (_U < 150), BLUE), (disc(150, 110, 20) & (_U >= 150), (90.0, 60.0, 20.0))
    )
    p = 0.4 * VIEW.rays([151.5, 111.5])
    radius_m = 0.4 * np.sin(18 / LEFT_EYE.focal_px)
    angles = 2 * np.pi * np.arange(48) / 48
    outward = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    cov = 1e-6 * np.eye(3)
    edge = [151.5, 111.5] + 18 * outward
    located = Located(p, cov, p, cov, radius_m, 0.01, 1.0, fill, ((edge, outward), (edge, outward)))
    state = known(tracker, picture(rng, (disc(150, 110, 18), BLUE)))
    state, examined = tracker.examine(state, seen_from(image), prior_at(150, 110))
    _, detection = tracker.detect(state, seen_from(image), examined, located, 0)
    assert (detection is not None) == (marker is None and min(fill) > 0.3)
    if detection is not None:
        np.testing.assert_allclose(detection.outline.center_px, [150, 110], atol=0.4)
        assert detection.outline.angular_radius_rad == pytest.approx(18 / LEFT_EYE.focal_px, rel=0.02)
        assert detection.outline.is_partial
        assert detection.outline.is_edge
        assert detection.score == fill[0]
