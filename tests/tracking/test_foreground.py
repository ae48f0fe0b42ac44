"""The background on images drawn by hand: a wall of constant colour before an eye at rest, a wall of soft spots before
one that turns."""

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import LEFT_EYE
from pps_vision.types import Image, Mask
from tracking.foreground import Background, ForegroundParams

VIEW = View(LEFT_EYE, transform())
PATCH = np.s_[100:130, 150:190]
INNER = np.s_[104:126, 154:186]
BOX = (150.0, 100.0, 40.0, 30.0)
WHOLE = (0, 0, 320, 240)
WALL = (100.0, 90.0, 110.0)
DT = 0.05
TURN_S = 0.1
RADIUS = 16
WALL_M = 1.2
_SPOTS = np.random.default_rng(1).uniform(60, 190, (40, 60, 3)).astype(np.float32)
SPOTTED = np.clip(cv2.resize(_SPOTS, (900, 600), interpolation=cv2.INTER_CUBIC), 0, 255)
_V, _U = np.mgrid[:240, :320]


def new_background() -> Background:
    return Background(ForegroundParams(), LEFT_EYE)


def draw(rng: np.random.Generator, patch: tuple[float, float, float] | None = None, noise: float = 2.0) -> Image:
    image = np.full((240, 320, 3), WALL)
    if patch is not None:
        image[PATCH] = patch
    return np.clip(np.rint(image + noise * rng.standard_normal(image.shape)), 0, 255).astype(np.uint8)


def learned(rng: np.random.Generator, noise: float = 2.0) -> Background:
    background = new_background()
    for k in range(12):
        background.update(draw(rng, noise=noise), VIEW, DT * k)
    return background


@pytest.mark.parametrize(
    "patch", [(60.0, 50.0, 70.0), (140.0, 130.0, 150.0), (100.0, 90.0, 150.0), (70.0, 90.0, 110.0)]
)
def test_a_patch_that_differs_in_any_channel_is_no_background(patch, rng):
    evidence = learned(rng).evidence(draw(rng, patch), VIEW, WHOLE)
    assert evidence[INNER].min() == 1
    evidence[96:134, 146:194] = 0
    assert (evidence > 0.5).mean() < 1e-3


@pytest.mark.parametrize("part", [np.s_[:, :150], np.s_[:, 170:], np.s_[:110], np.s_[130:]])
def test_the_light_is_measured_all_over_the_image(part, rng):
    """And changes nothing where the rest, less than half of it, is covered."""
    background = learned(rng)
    darker = np.rint(0.8 * draw(rng)).astype(np.uint8)
    darker[part] = (5, 40, 160)
    evidence = background.evidence(darker, VIEW, WHOLE) > 0.5
    assert evidence[part].mean() > 0.95
    evidence[part] = False
    assert evidence.mean() < 0.02


@pytest.mark.parametrize("fps", [3, 10, 120])
def test_it_becomes_background_as_soon_at_any_rate_of_images(fps, rng):
    background = new_background()
    changed_s = 1.0
    for k in range(int((changed_s + 0.9) * fps) + 3):
        background.update(draw(rng, (60.0, 50.0, 70.0) if k / fps >= changed_s else None), VIEW, k / fps)
        stays = changed_s <= k / fps < changed_s + 0.3 - 1 / fps
        if stays or k / fps > changed_s + 2 * (0.3 + 1 / fps):
            evidence = background.evidence(draw(rng, (60.0, 50.0, 70.0)), VIEW, WHOLE)[INNER]
            assert evidence.min() == 1 if stays else (evidence > 0.5).mean() < 0.01


@pytest.mark.parametrize(("levels", "box"), [((160.0, 180.0), None), ((160.0, 160.0), BOX)])
def test_what_keeps_changing_and_the_tracked_object_do_not_become_background(levels, box, rng):
    background = learned(rng)
    for k in range(12, 60):
        image = draw(rng, (levels[k // 6 % 2],) * 3)
        background.update(image, VIEW, DT * k, [] if box is None else [box])
    assert background.evidence(image, VIEW, WHOLE)[INNER].min() == 1
    assert background.evidence(draw(rng), VIEW, WHOLE)[INNER].mean() < 0.2


def test_noise_and_a_change_of_the_light_are_no_evidence(rng):
    noisy = learned(rng, noise=12.0)
    assert (noisy.evidence(draw(rng, noise=12.0), VIEW, WHOLE) > 0.5).mean() < 0.002
    background = learned(rng)
    brighter = np.clip(1.15 * draw(rng, (60.0, 50.0, 70.0)).astype(float), 0, 255).astype(np.uint8)
    background.update(brighter, VIEW, 12 * DT)
    evidence = background.evidence(brighter, VIEW, WHOLE)
    assert evidence[INNER].min() == 1
    evidence[96:134, 146:194] = 0
    assert (evidence > 0.5).mean() < 1e-2


@pytest.mark.parametrize("box", [BOX, (-10.0, -5.0, 40.0, 30.0), (300.0, 225.0, 40.0, 30.0)])
def test_what_an_object_hides_at_first_is_unknown_until_it_has_left(box, rng):
    """Within a pixel, as colours are compared with the range of their neighbourhood, and 0.3 sizes around the box."""
    background = new_background()
    image = draw(rng, noise=0.0)
    background.update(image, VIEW, 0.0, [box])
    x, y, w, h = box
    is_hidden = (np.abs(_U - x - w / 2) < 0.8 * w + 2) & (np.abs(_V - y - h / 2) < 0.8 * h + 2)
    is_inside = (np.abs(_U - x - w / 2) < 0.8 * w - 1) & (np.abs(_V - y - h / 2) < 0.8 * h - 1)
    unknown = background.differs(image, VIEW, WHOLE)
    assert unknown[is_inside].all()
    assert not unknown[~is_hidden].any()
    background.update(image, VIEW, 0.4)
    assert not background.differs(image, VIEW, WHOLE).any()


def test_what_is_behind_and_around_a_new_object_is_known_no_more(rng):
    """An object of 40 × 30 px, and changes within 80 px to its sides and 60 px above and below; the other parts of
    the wall stay known."""
    background = learned(rng)
    near = ((75, 110), (255, 110), (165, 45), (165, 172))
    distant = ((40, 110), (285, 110), (165, 15), (165, 205))
    marked = draw(rng)
    for x, y in (*near, *distant):
        marked[y : y + 12, x : x + 12] = (160, 150, 170)
    background.invalidate(marked, VIEW, BOX)
    wall = background.differs(draw(rng), VIEW, WHOLE)
    for x, y in near:
        assert wall[y + 2 : y + 10, x + 2 : x + 10].all()
    for x, y in distant:
        assert not wall[y + 2 : y + 10, x + 2 : x + 10].any()
    assert wall[100:130, 150:190].all()
    assert np.count_nonzero(wall) < 42 * 32 + 4 * 18**2


def turned(k: int, deg: float = 1.0) -> View:
    """View k of an eye that turns by `deg` from one image to the next."""
    return View(LEFT_EYE, transform(cv2.Rodrigues(np.array([0.0, np.deg2rad(deg) * k, 0.0]))[0]))


def seen(
    view: View, rng: np.random.Generator, disc_px: tuple[float, float] | None = None, wall_m: float = WALL_M
) -> tuple[Image, Mask]:
    """The spotted wall as seen from a view, with a white disc about a pixel; and where the disc is."""
    rays = view.rays(np.stack([_U, _V], axis=-1).reshape(-1, 2).astype(float)).reshape(240, 320, 3)
    at = ((rays[..., :2] / rays[..., 2:] + view.center[:2] / wall_m) * 400 + (450, 300)).astype(np.float32)
    image = cv2.remap(SPOTTED, at, np.empty(0, np.float32), cv2.INTER_LINEAR)
    mask = np.zeros((240, 320), bool)
    if disc_px is not None:
        mask = (_U - disc_px[0]) ** 2 + (_V - disc_px[1]) ** 2 < RADIUS**2
        image[mask] = (235.0, 235.0, 225.0)
    noisy = image + 2 * rng.standard_normal(image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8), np.asarray(mask)


def overlap(mask: Mask, true: Mask) -> float:
    return float(np.count_nonzero(mask & true) / np.count_nonzero(mask | true))


def turning(rng: np.random.Generator, n: int, start: tuple[float, float] | None = None) -> Background:
    """The background of a turning eye after n images, a disc moving down from `start` by 8 px an image."""
    background = new_background()
    for k in range(n):
        disc_px = None if start is None else (start[0], start[1] + 8 * k)
        background.update(seen(turned(k), rng, disc_px)[0], turned(k), TURN_S * k)
    return background


@pytest.mark.parametrize("rests", [False, True])
def test_what_comes_before_the_wall_is_no_background_though_the_eye_turns(rests, rng):
    """Also if it rested before."""
    background = new_background()
    for k in range(12):
        view = turned(11 if rests else k)
        background.update(seen(view, rng)[0], view, TURN_S * k)
    assert not background.rests(turned(12))
    image, disc = seen(turned(12), rng, (150.0, 120.0))
    box = (100, 70, 220, 180)
    part = background.differs(image, turned(12), box)
    assert overlap(part, disc[70:180, 100:220]) > 0.85
    evidence = background.evidence(image, turned(12), box)
    assert overlap(evidence > 0.5, disc[70:180, 100:220]) > 0.85


@pytest.mark.parametrize("deg", [1.0, 1.02, 1.125])
def test_nothing_moves_and_nothing_differs(deg, rng):
    """Except at the side where new background comes into view; where the pose is off, the threshold rises."""
    background = turning(rng, 12)
    image, _ = seen(turned(12), rng)
    assert background.differs(image, turned(12, deg), (40, 10, 280, 230)).mean() < 1e-3


def test_the_place_that_an_object_has_left_becomes_background(rng):
    """A disc is in view from the first image on; a second later its first place is none, and the disc still one."""
    background = turning(rng, 14, (150.0, 30.0))
    image, disc = seen(turned(14), rng, (150.0, 30.0 + 8 * 14))
    mask = background.differs(image, turned(14), (20, 5, 280, 235))
    assert overlap(mask, disc[5:235, 20:280]) > 0.85


@pytest.mark.parametrize("wall_m", [0.5, 5.0])
def test_a_resting_wall_at_any_distance_is_background_of_an_eye_that_moves_sideways(wall_m, rng):
    """By 2.4 cm between updates: 11 px at 0.5 m, 1 px at 5 m, 4 px at the distance assumed at first."""
    background = new_background()
    for k in range(12):
        view = View(LEFT_EYE, transform(translation=(0.008 * k, 0.0, 0.0)))
        image, _ = seen(view, rng, wall_m=wall_m)
        background.update(image, view, TURN_S * k)
    assert background.differs(image, view, (60, 10, 260, 230)).mean() < 0.01


@pytest.mark.parametrize("is_object", [True, False])
def test_the_place_that_an_object_has_left_is_told_by_its_colours(is_object, rng):
    background = new_background()
    view = turned(3)
    at = (150.0, 120.0)
    background.update(seen(turned(0), rng, None if is_object else at)[0], turned(0), 0.0)
    u, v = view.project(view.center + WALL_M * turned(0).rays(at))
    place = (_U - u) ** 2 + (_V - v) ** 2 < RADIUS**2
    image, _ = seen(view, rng, (u, v) if is_object else None)
    box = int(u) - 20, int(v) - 30, int(u) + 40, int(v) + 50
    for part, region in ((place, WHOLE), (place[box[1] : box[3], box[0] : box[2]], box)):
        assert background.is_ghost(image, view, part, region) == (not is_object)


def test_a_ghost_becomes_background_at_once_before_an_eye_that_rests(rng):
    background = new_background()
    at = (150.0, 120.0)
    before, place = seen(turned(0), rng, at)
    background.update(before, turned(0), 0.0)
    image, _ = seen(turned(0), rng)
    assert background.differs(image, turned(0), WHOLE)[place].mean() > 0.8
    assert background.is_ghost(image, turned(0), place, WHOLE)
    background.adopt(image, turned(0), place, WHOLE)
    assert background.differs(image, turned(0), WHOLE)[place].mean() < 0.2


def test_the_tracked_object_s_place_is_kept(rng):
    """An object that rests for seconds before a turning eye is not learned while it is tracked."""
    background = turning(rng, 12)
    direction = turned(12).rays([150.0, 120.0])
    for k in range(12, 32):
        view = turned(24 - k if k > 18 else k)
        u, v = view.project(view.center + WALL_M * direction)
        image, disc = seen(view, rng, (u, v))
        box_px = u - RADIUS, v - RADIUS, 2 * RADIUS, 2 * RADIUS
        background.update(image, view, TURN_S * k, [box_px])
    box = (int(u) - 30, int(v) - 30, int(u) + 30, int(v) + 30)
    assert overlap(background.differs(image, view, box), disc[box[1] : box[3], box[0] : box[2]]) > 0.85


def test_what_an_object_hides_when_the_eye_comes_to_rest_is_known_from_before(rng):
    background = turning(rng, 12)
    at = (150.0, 120.0)
    view = turned(11)
    for k in range(12, 18):
        background.update(seen(view, rng, at)[0], view, TURN_S * k, [(at[0] - 20, at[1] - 20, 40.0, 40.0)])
    assert background.rests(view)
    image, disc = seen(view, rng, at)
    assert (background.evidence(image, view, WHOLE) > 0.5)[disc].mean() > 0.9, "it is still no background"
    assert (background.evidence(seen(view, rng)[0], view, WHOLE) > 0.5)[disc].mean() < 0.05, "the wall behind it is"
