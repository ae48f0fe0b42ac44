"""The image tracker of one camera on drawn discs."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pps_vision.geometry.masks import Box
from pps_vision.robot.icub import LEFT_EYE
from pps_vision.types import Array, Image, Mask
from tracking.image_tracker import Foreground, ImageDetection, ImageTracker, SegmentedBy
from tracking.outline import Optics

BLUE = (30.0, 60.0, 210.0)
RED = (200.0, 40.0, 40.0)
BOX = (132.0, 92.0, 37.0, 37.0)
"""Of a disc of 18 px at (150, 110)."""
V, U = np.mgrid[:240, :320]


Differs = Callable[[Image, Box], Mask]


def angle_of(size_px: float) -> float:
    return 0.5 * size_px / LEFT_EYE.focal_px


def of_known_background(differs: Differs, image: Image) -> Foreground:
    def foreground(box: Box) -> tuple[Array, Mask]:
        mask = np.asarray(differs(image, box), np.float32)
        return mask, np.ones(mask.shape, bool)

    return foreground


class _Scene:
    """A tracker that knows a disc of 18 px at (150, 110), and the images that it sees."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.eye = ImageTracker(Optics(LEFT_EYE))
        self.start(self.discs((150, 110, 18)), BOX)

    def start(self, image: Image, box: tuple[float, float, float, float]) -> None:
        self.target = self.eye.start(image, box, angle_of(np.sqrt(box[2] * box[3])))

    def discs(self, *discs: tuple[float, float, float], bar: bool = False) -> Image:
        """Blue discs (x, y, radius px) amid grey noise, with a bar of their colour to the right of the first."""
        image = np.full((240, 320, 3), 120.0)
        for x, y, radius in discs:
            image[np.hypot(U - x, V - y) < radius] = BLUE
        if bar:
            x, y, _ = discs[0]
            image[(abs(V - y) < 3.5) & (x < U) & (x + 70 > U)] = BLUE
        return np.clip(image + 2 * self.rng.standard_normal(image.shape), 0, 255).astype(np.uint8)

    def evidence(self, image: Image, differs: Differs | None) -> Array:
        """At every pixel around the disc, by its colours."""
        foreground = differs and of_known_background(differs, image)
        examined = self.eye.examine(self.target, image, np.array([150.0, 110]), 60.0, foreground, "colour")
        x0, y0, x1, y1 = examined.roi
        evidence = np.full(image.shape[:2], np.nan)
        evidence[y0:y1, x0:x1] = examined.evidence.pixels
        return evidence

    def step(
        self,
        image: Image,
        x: float,
        y: float,
        differs: Differs | None = None,
        segmented_by: SegmentedBy | None = None,
        **options: Any,
    ) -> ImageDetection | None:
        """The whole object at the place where it was located; follows it."""
        center = np.array([x, y], float)
        by = segmented_by or ("colour and foreground" if differs else "colour")
        examined = self.eye.examine(
            self.target, image, center, 6.0, differs and of_known_background(differs, image), by
        )
        whole = examined and self.eye.detect(self.target, image, examined, center, **{"by_color": True} | options)
        if not whole:
            return None
        self.target, detection, _ = whole
        return detection


@pytest.fixture
def scene(rng: np.random.Generator) -> _Scene:
    return _Scene(rng)


@pytest.mark.parametrize(("share", "is_it"), [(1.2, True), (0.8, True), (0.7, True), (0.5, False)])
def test_what_is_of_quite_another_size_is_not_it(share, is_it, scene):
    """Four fifths of its radius pass, for two thirds of the score; half the radius, a quarter of the area, does not."""
    detection = scene.step(scene.discs((150, 110, share * 18)), 150, 110)
    assert (detection is not None) == is_it
    assert not is_it or detection.score == pytest.approx(min(share, 1 / share) ** 2, abs=0.05)


def test_what_is_hidden_in_part_is_not_whole(scene):
    """A disc, of known size, of which a tenth or more goes behind an edge; it is whole again when it comes back."""
    whole = []
    for edge in (*[200] * 8, *range(161, 150, -2), 200):
        image = scene.discs((150, 110, 18))
        image[edge <= U] = 120
        whole.append(scene.step(image, 150, 110, differs=_is_blue) is not None)
    assert whole == [True] * 8 + [False] * 6 + [True]


@pytest.mark.parametrize("is_background_known", [False, True])
def test_a_hoop_has_a_hole_where_its_background_shows(is_background_known, scene):
    hoop = scene.discs((150, 110, 25))
    hoop[np.hypot(U - 150, V - 110) < 15] = 120
    scene.start(scene.discs((150, 110, 25)), (125, 85, 51, 51))
    area_px = np.pi * (25**2 - 15**2)
    angle_rad = angle_of(2 * np.sqrt(area_px / np.pi))
    scene.target = replace(scene.target, angle_rad=angle_rad, shape=(51 / angle_rad, 51 / angle_rad))
    detection = scene.step(hoop, 150, 110, differs=_is_blue if is_background_known else None)
    assert detection.outline.area_px == pytest.approx(area_px, rel=0.05)


@pytest.mark.parametrize(("radius", "is_whole"), [(6, True), (14, False)])
def test_a_small_thing_that_touches_it_is_no_other_object(radius, is_whole, scene):
    """Beyond its reach, an eighth of its area or more than a quarter."""
    image = scene.discs((150, 110, 18), (150 + 17 + radius, 110, radius))
    detection = scene.step(image, 150, 110, differs=_is_blue)
    assert (detection is not None) == is_whole
    assert not is_whole or np.linalg.norm(detection.outline.center_px - [150, 110]) < 0.7


def _is_blue(image: np.ndarray, box: tuple[int, int, int, int]) -> np.ndarray:
    return np.asarray(image[box[1] : box[3], box[0] : box[2], 0] < 75)


def test_outside_the_image_nothing_is_searched(scene):
    """At the border and beyond it; and inside, where nothing has its colour, nothing is detected."""
    image = scene.discs((150, 110, 18))
    assert scene.step(scene.discs(), 150, 110) is None
    for along in range(0, 200, 3):
        for place in ((-along, 110), (320 + along, 110), (150, -along), (150, 240 + along)):
            assert scene.step(image, *place) is None


def _is_no_grey(image: np.ndarray, box: tuple[int, int, int, int]) -> np.ndarray:
    return np.asarray(np.ptp(image[box[1] : box[3], box[0] : box[2]].astype(int), axis=2) > 60)


def test_by_the_background_alone_an_object_may_take_any_colour(scene):
    """A disc that has turned from blue to red: its colours do not show it."""
    image = scene.discs((152, 111, 18))
    image[image[..., 0] < 75] = RED
    assert scene.step(image, 152, 111, differs=_is_no_grey) is None
    detection = scene.step(image, 152, 111, differs=_is_no_grey, segmented_by="foreground", by_color=False)
    assert np.linalg.norm(detection.outline.center_px - [152, 111]) < 0.1
    assert detection.score > 0.9


def test_what_colours_join_is_separated_by_what_differs_from_the_background(scene):
    """A blue disc before a blue wall's edge: colours show both, the foreground shows the disc alone."""
    disc = np.hypot(U - 150, V - 110) < 18
    joined = scene.discs((150, 110, 18))
    joined[:, 165:260] = BLUE

    def differs(_: Image, box: tuple[int, int, int, int]) -> Mask:
        return np.asarray(disc[box[1] : box[3], box[0] : box[2]])

    assert scene.step(joined, 150, 110) is None
    detection = scene.step(joined, 150, 110, differs=differs, segmented_by="colour")
    assert np.linalg.norm(detection.outline.center_px - [150, 110]) < 0.3


def test_evidence_tells_the_object_from_background_and_from_what_is_before_it(scene):
    """1 on the object, -1 on the background, in between on foreground of another colour, which may be in front of it;
    foreground beside the object that has its colour speaks against this colour, once it is learned."""
    image = scene.discs((150, 110, 18))
    image[(U >= 150) & (U < 190) & (V < 140)] = RED
    image[(U >= 200) & (U < 230) & (V < 140)] = BLUE
    at = {"object": (110, 140), "hand": (110, 175), "background": (110, 110), "alike": (110, 210)}
    evidence = scene.evidence(image, _is_no_grey)
    values = {name: evidence[place] for name, place in at.items()}
    assert values == pytest.approx({"object": 1, "hand": -0.3, "background": -1, "alike": 1}, abs=0.05)
    assert scene.evidence(image, None)[at["hand"]] == pytest.approx(-1, abs=0.05)
    center = np.array([150.0, 110])
    for _ in range(10):
        foreground = of_known_background(_is_no_grey, image)
        examined = scene.eye.examine(scene.target, image, center, 60.0, foreground, "colour")
        scene.target = scene.eye.learn_rivals(scene.target, examined, center)
    assert -0.5 < scene.evidence(image, _is_no_grey)[at["object"]] < 0.5
