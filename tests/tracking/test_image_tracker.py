"""The image tracker of one camera, its colours and its particles, each against something simpler."""

import colorsys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from pps_vision.robot.icub import LEFT_EYE
from pps_vision.types import Image, Mask
from tracking.acquisition import segment
from tracking.appearance import N_BINS, ColorModel, color_bins, histogram, is_same_object
from tracking.ego_motion import Box
from tracking.image_tracker import ImageDetection, ImageTracker, ImageTrackerParams
from tracking.motion_trigger import Region2D
from tracking.outline import Optics
from tracking.particle_filter import SHARPNESS, Particles, Prior, box_sums, likelihoods, propagate, resample, sample

BLUE = (30.0, 60.0, 210.0)
RED = (200.0, 40.0, 40.0)
BOX = (132.0, 92.0, 37.0, 37.0)
"""Of a disc of 18 px at (150, 110)."""


Differs = Callable[[Image, tuple[int, int, int, int]], Mask]


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


class _Scene:
    """A tracker that knows a disc of 18 px at (150, 110), and the images that it sees."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.eye = ImageTracker(ImageTrackerParams(), Optics(LEFT_EYE), rng)
        self.target = self.eye.start(self.discs((150, 110, 18)), BOX)

    def discs(self, *discs: tuple[float, float, float], bar: bool = False) -> Image:
        return _discs(self.rng, *discs, bar=bar)

    def step(
        self, image: Image, x: float, y: float, std_px: float = 1.0, differs: Differs | None = None, **options: Any
    ) -> ImageDetection | None:
        """The detection near a predicted place; follows it."""
        prior = Prior(np.array([x, y], float), std_px, 1.0)
        evidence = differs and partial(differs, image)
        self.target, detection = self.eye.step(self.target, image, prior, evidence, **options)
        return detection


@pytest.fixture
def scene(rng: np.random.Generator) -> _Scene:
    return _Scene(rng)


@pytest.mark.parametrize(("share", "is_it"), [(1.2, True), (0.8, True), (0.7, True), (0.5, False)])
def test_what_is_of_quite_another_size_is_not_it(share, is_it, scene):
    """Four fifths of its radius pass, for two thirds of the score; half the radius, a quarter of the area, does not."""
    detection = scene.step(scene.discs((150, 110, share * 18)), 150, 110, 3.0)
    assert (detection is not None) == is_it
    assert not is_it or detection.score == pytest.approx(min(share, 1 / share) ** 2, abs=0.05)


@pytest.mark.parametrize("way", [(1, 0.5), (-1, 0.5), (0.5, 1), (0.5, -1)])
def test_a_wide_prediction_finds_what_is_far_from_it_and_no_small_thing_nearer(way, scene):
    """A disc 50 px from where it is predicted ± 36 px, and to the other side a spot of its colour."""
    u, v = np.add((150, 110), 50 * np.array(way))
    spot_u, spot_v = np.add((150, 110), -40 * np.array(way))
    detection = scene.step(scene.discs((u, v, 18), (spot_u, spot_v, 5)), 150, 110, 36.0)
    np.testing.assert_allclose(detection.outline.center_px, [u, v], atol=0.3)
    particles = scene.target.particles.current
    np.testing.assert_allclose(particles.mean(axis=0), [u, v, scene.target.size], atol=0.5)


def test_size_and_sides_follow_by_three_tenths_an_image(scene):
    """In the logarithm: a square of 32 px that becomes 40 px high."""
    images = [np.full((LEFT_EYE.height, LEFT_EYE.width, 3), 120, np.uint8) for _ in range(2)]
    for image, half in zip(images, (16, 20), strict=True):
        image[110 - half : 110 + half, 134:166] = BLUE
    scene.target = scene.eye.start(images[0], (134, 94, 32, 32))
    detection = scene.step(images[1], 149.5, 109.5)
    assert detection.box_px[2] * detection.box_px[3] == pytest.approx(32**2 * 1.25**0.3, rel=0.01)
    assert detection.box_px[3] / detection.box_px[2] == pytest.approx(1.25**0.3, rel=0.01)
    np.testing.assert_allclose(
        np.add(detection.box_px[:2], np.subtract(detection.box_px[2:], 1) / 2), 149.5 - np.array([0, 40]), atol=0.1
    )


def test_a_hoop_has_a_hole_where_its_background_shows(scene):
    """By colours; in front of a known background holes are the object's."""
    v, u = np.mgrid[: LEFT_EYE.height, : LEFT_EYE.width]
    hoop = scene.discs((150, 110, 25))
    hoop[np.hypot(u - 150, v - 110) < 15] = 120
    target = scene.eye.start(hoop, (125, 85, 51, 51))
    for differs, inner in ((None, 15), (_is_blue, 0)):
        scene.target = target
        scene.target = replace(target, fill=(25**2 - inner**2) * np.pi / 51**2)
        assert scene.step(hoop, 150, 110, differs=differs).outline.area_px == pytest.approx(
            np.pi * (25**2 - inner**2), rel=0.05
        )


def test_a_gap_of_a_twentieth_of_an_object_before_its_own_colour_is_closed(scene):
    """A disc of 40 px that a bar of the background's colour crosses, 7 px wide; a wider bar parts it."""
    image = scene.discs((150, 110, 40))
    target = scene.eye.start(image, (110, 70, 81, 81))
    for width, is_parted in ((7, False), (12, True)):
        parted = image.copy()
        parted[:, 155 : 155 + width] = 120
        scene.target = target
        assert scene.step(parted, 150, 110, differs=_is_blue).outline.is_partial == is_parted


@pytest.mark.parametrize(("radius", "touches"), [(6, False), (14, True)])
def test_a_small_thing_that_touches_it_is_no_other_object(radius, touches, scene):
    """Beyond its reach, an eighth of its area or more than a quarter."""
    image = scene.discs((150, 110, 18), (150 + 17 + radius, 110, radius))
    detection = scene.step(image, 150, 110, differs=_is_blue)
    np.testing.assert_allclose(detection.outline.center_px, [150, 110], atol=0.7)
    assert (scene.target.touched > 0) == touches


def test_two_alike_that_touch_are_told_apart_by_their_edge_and_the_prediction(scene):
    """Before a known background: a disc of 18 px at its predicted place, which another passes; the other is not it."""
    result = []
    for apart in (34, 26, 18, -18, -26, -34):
        image = scene.discs((152, 111, 18), (152 + apart, 111, 16))
        detection = scene.step(image, 152.3, 110.8, 0.7, differs=_is_blue)
        assert scene.target.touched
        result += [] if detection is None else [detection.outline.center_px]
    assert len(result) >= 4
    assert np.abs(np.array(result) - [152, 111]).max() < 0.3
    last = scene.target
    assert scene.step(scene.discs((158, 111, 16)), 152.3, 110.8, 0.7, differs=_is_blue) is None
    scene.target = last
    touched = []  # number of images for which the other disc may still hide it
    for _ in range(6):
        assert scene.step(scene.discs((152, 111, 18)), 152.3, 110.8, 0.7, differs=_is_blue)
        touched.append(scene.target.touched)
    assert touched == [4, 3, 2, 1, 0, 0]


def _is_blue(image: np.ndarray, box: tuple[int, int, int, int]) -> np.ndarray:
    return np.asarray(image[box[1] : box[3], box[0] : box[2], 0] < 75)


@pytest.mark.parametrize("edge", ["straight", "ragged"])
def test_what_is_hidden_in_part_keeps_its_size(edge, scene):
    """A disc of 18 px goes behind an edge, by 4 px an image; behind a ragged edge no disc is fitted."""
    initial = scene.target.size
    partial_views = 0
    v, u = np.mgrid[: LEFT_EYE.height, : LEFT_EYE.width]
    for x in range(154, 171, 4):
        image = scene.discs((x, 110, 18))
        image[u >= 168 + (8 * np.sin(v / 2) if edge == "ragged" else 0)] = 120
        partial_views += scene.step(image, x, 110, differs=_is_blue).outline.is_partial
    assert partial_views >= 3
    assert abs(scene.target.size / initial - 1) < 0.03


def test_a_thin_thing_of_its_colour_that_touches_it_is_no_part_of_it(scene):
    outline = scene.step(scene.discs((150, 110, 18), bar=True), 150, 110, 3.0).outline
    assert np.linalg.norm(outline.center_px - [150, 110]) < 0.5
    assert outline.area_px == pytest.approx(np.pi * 18**2, rel=0.03)


def test_outside_the_image_nothing_is_searched(scene):
    """At the border and beyond it."""
    image = scene.discs((150, 110, 18))
    start = scene.target
    for along in range(0, 200, 3):
        for place in ((-along, 110), (320 + along, 110), (150, -along), (150, 240 + along)):
            for std_px in (3.0, 30.0):
                scene.target = start
                assert scene.step(image, *place, std_px) is None


def test_where_nothing_has_its_colour_it_is_not_seen(scene):
    """Its state is kept; the particles stay around the predicted position."""
    last = scene.target
    assert scene.step(scene.discs(), 160, 115) is None
    after = scene.target
    assert after.model is last.model
    assert (after.size, after.shape, after.fill, after.touched) == (last.size, last.shape, last.fill, 0)
    np.testing.assert_allclose(after.particles.current[:, :2].mean(axis=0), [160, 115], atol=2)


def _is_no_grey(image: np.ndarray, box: tuple[int, int, int, int]) -> np.ndarray:
    return np.asarray(np.ptp(image[box[1] : box[3], box[0] : box[2]].astype(int), axis=2) > 60)


def test_by_the_background_alone_an_object_may_take_any_colour(scene):
    """A disc that has turned from blue to red: its colours do not show it."""
    image = scene.discs((152, 111, 18))
    image[image[..., 0] < 75] = (200, 40, 40)
    assert scene.step(image, 152, 111, differs=_is_no_grey) is None
    detection = scene.step(image, 152, 111, differs=_is_no_grey, by_color=False)
    assert np.linalg.norm(detection.outline.center_px - [152, 111]) < 0.1
    assert detection.score > 0.9


def test_what_colours_join_is_searched_once_more_in_what_differs_from_the_background(scene):
    """A blue disc before a blue wall's edge: colours show both, the foreground shows the disc alone."""
    requested_boxes = []
    v, u = np.mgrid[:240, :320]
    disc = np.hypot(u - 150, v - 110) < 18
    joined = scene.discs((150, 110, 18))
    joined[:, 165:260] = BLUE

    def differs(box: tuple[int, int, int, int]) -> np.ndarray:
        requested_boxes.append(box)
        return np.asarray(disc[box[1] : box[3], box[0] : box[2]])

    detection = scene.step(joined, 150, 110, if_joined=differs)
    assert requested_boxes
    assert np.linalg.norm(detection.outline.center_px - [150, 110]) < 0.3
    requested_boxes.clear()
    assert scene.step(scene.discs((150, 110, 18)), 150, 110, if_joined=differs)
    assert not requested_boxes  # nothing is joined


def test_a_long_object_is_followed_over_its_whole_length(scene):
    images = [np.full((LEFT_EYE.height, LEFT_EYE.width, 3), 120, np.uint8) for _ in range(2)]
    for image, x in zip(images, (100, 106), strict=True):
        image[105:115, x : x + 80] = BLUE
    scene.target = scene.eye.start(images[0], (100, 105, 80, 10))
    np.testing.assert_allclose(scene.step(images[1], 145.5, 109.5, 2.0).outline.box_px, (106, 105, 80, 10), atol=1)


class _Unchanged:
    """A foreground that shows nothing, and leaves it to distinct colours."""

    def confirms(self, colored: Mask, box: Box, is_distinct: bool) -> bool:
        return is_distinct

    def moved_mask(self, seed: Mask, box: Box) -> None: ...

    disoccluded_mask = moved_mask


def test_where_an_object_has_the_colours_of_what_is_around_none_is_taken_up(rng):
    """Blue among specks: none, an eighth, a quarter, or two thirds as many as in the disc; with few of them its colours
    alone tell it where a foreground is known."""
    v, u = np.mgrid[: LEFT_EYE.height, : LEFT_EYE.width]
    disc = np.hypot(u - 150, v - 110) < 15
    region = Region2D((138, 98, 25, 25), np.ones((25, 25), bool), 1.0)
    for around, is_taken, is_distinct in (
        (0.0, True, True),
        (0.12, True, False),
        (0.25, True, False),
        (0.6, False, False),
    ):
        blue = rng.random(disc.shape) < np.where(disc, 0.9, around)
        image = np.where(blue[..., None], BLUE, RED).astype(np.uint8)
        assert (segment(image, region, Optics(LEFT_EYE)) is not None) == is_taken
        assert (segment(image, region, Optics(LEFT_EYE), _Unchanged()) is not None) == is_distinct


def test_bins_are_hue_and_saturation_or_value(rng):
    image = rng.integers(0, 256, (40, 40, 3), dtype=np.uint8)
    bins = color_bins(image)
    agree = 0
    for rgb, got in zip(image.reshape(-1, 3), bins.ravel(), strict=True):
        h, s, v = colorsys.rgb_to_hsv(*((rgb // 4 * 4 + 2) / 255))
        grey = s < 40 / 255 or v < 25 / 255
        agree += got == (100 + min(int(v * 10), 9) if grey else 10 * int(h * 10) + min(int(s * 10), 9))
    assert agree > 0.96 * bins.size  # the rest lies on the edges, where 8-bit hues round


def test_a_color_only_the_object_has_is_the_object():
    red, blue = (color_bins(np.full((8, 8, 3), color, np.uint8)) for color in ((200, 0, 0), (0, 0, 200)))
    model = ColorModel(histogram(red), histogram(blue))
    table = model.table()
    assert len(table) == N_BINS
    assert table[red[0, 0]] > 0.9
    assert table[blue[0, 0]] == 0
    assert model.similarity(model.object) == pytest.approx(1)
    assert model.similarity(model.background) == 0
    half = model.blend(ColorModel(model.background, model.object), 0.5, 0.25)
    assert half.similarity(model.object) == pytest.approx(np.sqrt(0.5))
    np.testing.assert_allclose(half.background, 0.75 * model.background + 0.25 * model.object)
    rare = ColorModel(0.999 * model.object + 0.001 * model.background, np.zeros(N_BINS))
    assert rare.table()[blue[0, 0]] < 0.5  # one pixel in a thousand of the object, none elsewhere
    assert histogram(np.zeros((2, 2), np.uint8), np.zeros((2, 2), np.float32)).sum() == pytest.approx(1)


def model(share: float) -> ColorModel:
    """A share of one colour, the rest of another."""
    colors = np.zeros(N_BINS)
    colors[[3, 40]] = share, 1 - share
    return ColorModel(colors, np.full(N_BINS, 1 / N_BINS))


@pytest.mark.parametrize(
    ("left", "right", "radius_m", "is_same"),
    [
        (0.9, 0.9, 0.03, True),
        (0.8, 0.95, 0.025, True),
        (0.9, 0.1, 0.03, False),  # another colour in one eye
        (0.1, 0.9, 0.03, False),
        (0.9, 0.9, 0.02, False),  # another size
        (0.9, 0.9, 0.04, False),
    ],
)
def test_colours_in_either_eye_and_size_must_agree(left, right, radius_m, is_same):
    tracked = (model(0.9), model(0.9))
    detected = (model(left), model(right))
    assert is_same_object(tracked, 0.03, detected, radius_m) == is_same


def test_a_box_is_made_of_the_pixels_around_its_centre(rng):
    """An odd number of pixels a side around a pixel; a corner of the region and its border included."""
    image = rng.random((20, 30))
    integral = np.zeros((21, 31))
    integral[1:, 1:] = image.cumsum(axis=0).cumsum(axis=1)
    places = [(10, 8), (11, 9), (0, 0), (29, 19)]
    particles = np.array([[100.0 + x, 50.0 + y, 2.0] for x, y in places])
    wanted = [image[max(y - 1, 0) : y + 2, max(x - 2, 0) : x + 3].sum() for x, y in places]
    np.testing.assert_allclose(box_sums(integral, particles, (100, 50), (1.25, 0.75)), wanted)


def test_a_box_of_the_objects_size_outweighs_a_larger_one():
    """40 × 10 px on a background of as many pixels as one likes: 400 px gained, or 400 less the other 1200."""
    score = np.full((120, 160), -1.0)
    score[55:65, 70:110] = 1.0
    integral = np.zeros((121, 161))
    integral[1:, 1:] = score.cumsum(axis=0).cumsum(axis=1)
    current = np.array([[89.5, 59.5, 20.0], [89.5, 59.5, 40.0]])
    small, large = likelihoods(Particles(current, current), integral, (0, 0), (2.0, 0.5))
    assert np.log(small / large) == pytest.approx(SHARPNESS * (400 + 800) / 30**2)


def test_weights_add_up_to_one_even_where_no_box_holds_the_object():
    """Boxes far larger than expected lose by every pixel: of their gains alone none would have a weight."""
    integral = np.zeros((121, 161))
    integral[1:, 1:] = -np.ones((120, 160)).cumsum(axis=0).cumsum(axis=1)
    current = np.array([[80.0, 60.0, 1.0]] * 3 + [[80.0, 60.0, 100.0]] * 2)
    weights = likelihoods(Particles(current, current), integral, (0, 0), (0.5, 0.5))
    assert weights.sum() == pytest.approx(1)
    np.testing.assert_allclose(weights[:3], 1 / 3)
    shifted = likelihoods(Particles(current[3:], current[3:]), 1e3 * integral, (0, 0), (0.01, 0.01))
    np.testing.assert_allclose(shifted, 0.5)


@pytest.mark.parametrize(("std_px", "spread_px"), [(None, 10.0), (1.0, 2.2), (9.0, 9.0)])
def test_particles_go_on_as_before_or_to_the_prediction(std_px, spread_px, rng):
    """Of an object of 40 px, without a prediction ± a quarter of it; with one that it grows by a tenth, ± at least a
    twentieth; in size ± 4 %."""
    before = sample(5000, np.array([100.0, 50.0]), 40.0, 0.5, rng, np.array([6.0, -3.0]))
    prior = None if std_px is None else Prior(np.array([90.0, 60.0]), std_px, 1.1)
    x, y, size = propagate(before, prior, rng).current.T
    np.testing.assert_allclose((x.mean(), y.mean()), (90, 60) if prior else (106, 47), atol=0.6)
    np.testing.assert_allclose((x.std(), y.std()), np.hypot(spread_px, 0.5), rtol=0.05)
    assert np.log(size / 40).mean() == pytest.approx(np.log(1.1) if prior else 0.0, abs=0.003)
    assert np.log(size).std() == pytest.approx(0.04, rel=0.05)


def test_resampled_particles_keep_their_past(rng):
    current = rng.random((50, 3))
    chosen = resample(Particles(current, current - 1.0), rng.dirichlet(np.ones(50)), rng)
    np.testing.assert_allclose(chosen.current - chosen.previous, 1.0)
    last = np.zeros(50)
    last[-1] = 0.3  # of rounding no sum of weights need reach one
    np.testing.assert_array_equal(
        resample(Particles(current, current), last, rng).current, np.tile(current[-1], (50, 1))
    )
