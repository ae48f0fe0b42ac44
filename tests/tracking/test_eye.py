"""One eye finds its object where it hardly knows where to look."""

from dataclasses import replace

import numpy as np
from raycast import Sphere, look

from pps_vision.geometry.camera import View
from pps_vision.robot.icub import LEFT_EYE
from tracking.acquire import AcquireParams, acquire
from tracking.eye import EyeParams, EyeTracker, Sighting
from tracking.follow import Follower, alike, find_both
from tracking.kalman import Belief
from tracking.look import Look
from tracking.motion_trigger import Region2D
from tracking.outline import Optics, Outline
from tracking.particles import Prior

BLUE, RED = (30.0, 60.0, 210.0), (200.0, 40.0, 40.0)


def test_a_small_object_is_found_anywhere_in_a_wide_prior_with_any_particles() -> None:
    """5 px of radius, 45 px from where it was, a large thing of half its colour beside it."""
    optics, here = Optics(LEFT_EYE), View(LEFT_EYE, np.eye(4))
    before, now = np.array([0.0, 0.0, 0.5]), np.array([0.09, 0.03, 0.5])
    clutter = Sphere(np.array([-0.1, 0.0, 0.6]), 0.06, RED)
    was, true = LEFT_EYE.project(before), LEFT_EYE.project(now)
    assert np.linalg.norm(true - was) > 40
    for seed in range(12):
        rng = np.random.default_rng(seed)
        eye = EyeTracker(EyeParams(), optics, rng)
        eye.start(look(here, [clutter, Sphere(before, 0.012, BLUE)], rng), (was[0] - 5, was[1] - 5, 11.0, 11.0))
        seen = eye.step(look(here, [clutter, Sphere(now, 0.012, BLUE)], rng), Prior(was, 40.0, 1.0))
        assert seen is not None
        assert np.linalg.norm(seen.outline.center_px - true) < 0.5


def test_what_only_one_eye_completes_is_measured_as_it_shows_in_both() -> None:
    def seen(u: float, departure: float, shown: Outline | None = None) -> Sighting:
        size = (u - 20, 90.0, 40.0, 40.0)
        return Sighting(
            Outline(np.array([u, 110.0]), np.eye(2), 0.1, 1e-6, size, 1200.0, False, departure, shown), size, 1
        )

    part, odd, ball = seen(100.0, 0.1).outline, 0.1, 0.0
    completed, plain = seen(104.0, odd, part), seen(90.0, odd)
    assert [one and one.outline.center_px[0] for one in alike(completed, plain, odd=False)] == [100.0, 90.0]
    assert [one and one.outline.center_px[0] for one in alike(plain, completed, odd=False)] == [90.0, 100.0]
    assert [one and one.outline.center_px[0] for one in alike(completed, completed, odd=False)] == [104.0, 104.0]
    assert alike(completed, seen(90.0, ball), odd=False)[0] is completed
    assert alike(completed, None, odd=False) == (completed, None)


def test_what_has_been_no_ball_all_along_is_none_because_one_eyes_rim_fits_a_cone() -> None:
    """And a ball that has been one, half hidden now, is completed in either eye."""
    shown = Outline(np.array([100.0, 80.0]), np.eye(2), 0.1, 1e-6, (90.0, 70.0, 20.0, 20.0), 300.0, False, 0.1)
    ball = replace(shown, center_px=np.array([106.0, 80.0]), departure=0.0, shown=shown)
    left, right = (Sighting(one, one.box_px, 1.0) for one in (ball, shown))
    for odd, x in ((True, 100.0), (False, 106.0)):
        found = alike(left, right, odd)
        assert found[0] is not None
        assert found[1] is not None
        assert (found[0].outline.center_px[0], found[1].outline.center_px[0]) == (x, 100.0)
    alone = alike(left, None, odd=True)[0]
    assert alone is not None
    assert alone.outline is shown


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


def _knowing(rng: np.random.Generator) -> EyeTracker:
    """An eye that knows a disc of 18 px at (150, 110)."""
    eye = EyeTracker(EyeParams(notched=False), Optics(LEFT_EYE), rng)
    eye.start(_discs(rng, (150, 110, 18)), (132.0, 92.0, 37.0, 37.0))
    return eye


def test_what_is_of_quite_another_size_is_not_it(rng: np.random.Generator) -> None:
    """Four fifths of its radius pass, for two thirds of the score; half the radius, a quarter of the area, does not."""
    prior = Prior(np.array([150.0, 110.0]), 3.0, 1.0)
    smaller = _knowing(rng).step(_discs(rng, (150, 110, 0.8 * 18)), prior)
    assert smaller is not None
    assert abs(smaller.score - 0.64) < 0.1
    assert _knowing(rng).step(_discs(rng, (150, 110, 0.5 * 18)), prior) is None


def test_a_thin_thing_of_its_colour_that_touches_it_is_no_part_of_it(rng: np.random.Generator) -> None:
    seen = _knowing(rng).step(_discs(rng, (150, 110, 18), bar=True), Prior(np.array([150.0, 110.0]), 3.0, 1.0))
    assert seen is not None
    assert np.linalg.norm(seen.outline.center_px - [150, 110]) < 0.5
    assert abs(seen.outline.area_px / (np.pi * 18**2) - 1) < 0.03


def _moved_at(box: tuple[int, int, int, int]) -> Region2D:
    return Region2D(box, np.ones((box[3], box[2]), bool), 1.0)


def test_where_an_object_has_the_colours_of_what_is_around_none_is_taken_up(rng: np.random.Generator) -> None:
    """Blue among specks: as many as in the disc, half as many, or none."""
    v, u = np.mgrid[: LEFT_EYE.height, : LEFT_EYE.width]
    disc, optics = np.hypot(u - 150, v - 110) < 15, Optics(LEFT_EYE)
    taken = []
    for around in (0.0, 0.25, 0.6):
        blue = rng.random(disc.shape) < np.where(disc, 0.9, around)
        image = np.where(blue[..., None], BLUE, RED).astype(np.uint8)
        taken.append(acquire(AcquireParams(), image, _moved_at((138, 98, 25, 25)), optics) is not None)
    assert taken == [True, True, False]


def test_what_fills_little_of_its_box_is_no_object(rng: np.random.Generator) -> None:
    """A streak of 8 px across, along the image's diagonal and along its edge."""
    v, u = np.mgrid[: LEFT_EYE.height, : LEFT_EYE.width]
    optics = Optics(LEFT_EYE)
    for slope, taken in ((0.0, True), (1.0, False)):
        image = np.full((LEFT_EYE.height, LEFT_EYE.width, 3), 120.0)
        image[(abs(v - 110 - slope * (u - 150)) < 4 * np.hypot(1, slope)) & (abs(u - 150) < 30)] = BLUE
        image = np.clip(image + 2 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)
        assert (acquire(AcquireParams(), image, _moved_at((140, 104, 21, 13)), optics) is not None) == taken


def test_what_was_found_in_both_images_already_takes_the_particles_along(rng: np.random.Generator) -> None:
    """To another place, and a size that they would take for another object's."""
    view, p, image = View(LEFT_EYE, np.eye(4)), np.array([0.06, 0.03, 0.4]), _discs(rng, (150, 110, 18))
    (x, y), look_now = view.project(p), Look(image, view, 0.0, None)
    eyes = [Follower(name, Optics(LEFT_EYE), EyeParams(), None, 0.3, rng) for name in ("left", "right")]
    belief = Belief(0.0, np.array([p, np.zeros(3)]), 1e-8 * np.eye(6), np.zeros((3, 3)), 0.0)
    box = (x - 28, y - 28, 56.0, 56.0)
    large = Outline(np.array([x, y]), 0.01 * np.eye(2), 28 / LEFT_EYE.focal_px, 1e-6, box, np.pi * 28**2, False, 0.0)
    for eye in eyes:
        eye.object.start(image, (132.0, 92.0, 37.0, 37.0))
        eye.remember(look_now, large, belief)
    there = ([large], [large])
    assert None not in find_both((eyes[0], eyes[1]), (look_now, look_now), belief, belief, False, False, there)
    for eye in eyes:
        seen = eye.object.step(_discs(rng, (x, y, 28)))
        assert seen is not None
        assert np.linalg.norm(seen.outline.center_px - [x, y]) < 0.3
