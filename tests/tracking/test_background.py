"""The background on images drawn by hand: a wall of constant colour, a patch of another colour, noise."""

import numpy as np
import pytest

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import LEFT_EYE
from tracking.background import Background
from tracking.ego_motion import EgoMotion

VIEW = View(LEFT_EYE, transform())
PATCH = np.s_[100:130, 150:190]
INNER = np.s_[104:126, 154:186]
BOX = (150.0, 100.0, 40.0, 30.0)
WHOLE = (0, 0, 320, 240)
WALL = (100.0, 90.0, 110.0)
DT = 0.05


def draw(rng: np.random.Generator, patch: tuple[float, float, float] | None = None, noise: float = 2.0) -> np.ndarray:
    image = np.full((240, 320, 3), WALL)
    if patch is not None:
        image[PATCH] = patch
    return np.clip(np.rint(image + noise * rng.standard_normal(image.shape)), 0, 255).astype(np.uint8)


def learned(rng: np.random.Generator, noise: float = 2.0) -> Background:
    background = Background(EgoMotion(LEFT_EYE), 0.3)
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
    background = Background(EgoMotion(LEFT_EYE), 0.3)
    changed_s = 1.0
    for k in range(int((changed_s + 0.9) * fps) + 3):
        background.update(draw(rng, (60.0, 50.0, 70.0) if k / fps >= changed_s else None), VIEW, k / fps)
        stays = changed_s <= k / fps < changed_s + 0.3 - 1 / fps
        if stays or k / fps > changed_s + 0.3 + 2 * 0.2 + 2 / fps:
            evidence = background.evidence(draw(rng, (60.0, 50.0, 70.0)), VIEW, WHOLE)[INNER]
            assert evidence.min() == 1 if stays else evidence.max() < 0.5


@pytest.mark.parametrize(("levels", "box"), [((160.0, 180.0), None), ((160.0, 160.0), BOX)])
def test_what_keeps_changing_and_the_tracked_object_do_not_become_background(levels, box, rng):
    background = learned(rng)
    for k in range(12, 60):
        image = draw(rng, (levels[k // 4 % 2],) * 3)
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


def test_it_begins_anew_when_the_eye_moves(rng):
    """As before there is a background, nothing is evidence."""
    assert not Background(EgoMotion(LEFT_EYE), 0.3).is_known(VIEW)
    background = learned(rng)
    moved = View(LEFT_EYE, transform(translation=(0.001, 0.0, 0.0)))
    patch = (160.0, 150.0, 170.0)
    assert not background.evidence(draw(rng, patch), moved, WHOLE).any()
    background.update(draw(rng, patch), moved, 0.6)
    assert background.evidence(draw(rng, patch), moved, WHOLE)[INNER].mean() < 0.5
    assert not background.is_known(VIEW)


def _marked(rng: np.random.Generator, *corners: tuple[int, int]) -> np.ndarray:
    image = draw(rng)
    for x, y in corners:
        image[y : y + 12, x : x + 12] = (160, 150, 170)
    return image


def test_what_is_behind_and_around_a_new_object_is_known_no_more(rng):
    """An object of 40 × 30 px, and changes within 80 px to its sides and 60 px above and below; the other parts of
    the wall stay known."""
    background = learned(rng)
    near = ((75, 110), (255, 110), (165, 45), (165, 172))
    distant = ((40, 110), (285, 110), (165, 15), (165, 205))
    background.invalidate_box(_marked(rng, *near, *distant), VIEW, BOX)
    wall = background.differs(draw(rng), VIEW, WHOLE)
    for x, y in near:
        assert wall[y + 2 : y + 10, x + 2 : x + 10].all()
    for x, y in distant:
        assert not wall[y + 2 : y + 10, x + 2 : x + 10].any()
    assert wall[100:130, 150:190].all()
    assert np.count_nonzero(wall) < 40 * 30 + 4 * 16**2
    other_view = View(LEFT_EYE, transform(translation=(0.1, 0.0, 0.0)))
    background.invalidate_box(draw(rng), other_view, (0.0, 0.0, 320.0, 240.0))  # not its background
    assert not background.differs(draw(rng), VIEW, (0, 0, 60, 60)).any()


def test_what_looks_like_the_background_behind_an_object_may_be_the_object(rng):
    """Unknown afterwards: the part of the mask that equals the background, and foreground beside the mask."""
    background = learned(rng)
    mask = np.zeros((40, 60), bool)
    mask[10:22, 10:30] = True  # the first mark, and 8 px of wall to its right
    background.invalidate(_marked(rng, (150, 100), (180, 100)), VIEW, mask, (140, 90, 200, 130))
    row = background.differs(draw(rng), VIEW, WHOLE)[102:110]
    assert [row[:, x : x + 6].mean() for x in (152, 163, 172, 182)] == [0, 1, 0, 1]


@pytest.mark.parametrize("box", [BOX, (-10.0, -5.0, 40.0, 30.0), (300.0, 225.0, 40.0, 30.0)])
def test_what_an_object_hides_at_first_is_unknown(box, rng):
    background = Background(EgoMotion(LEFT_EYE), 0.3)
    background.update(draw(rng, noise=0.0), VIEW, 0.0, [box])
    hidden = np.zeros((240, 320), bool)
    x, y, w, h = (int(level) for level in box)
    hidden[max(y, 0) : y + h, max(x, 0) : x + w] = True
    np.testing.assert_array_equal(background.differs(draw(rng, noise=0.0), VIEW, WHOLE), hidden)


def test_what_an_object_hides_at_first_is_what_the_moving_eye_had_learned_there(rng):
    """It knew the wall but for a corner of the box; from now on the eye rests."""
    background = Background(EgoMotion(LEFT_EYE), 0.3)
    mean = np.full((240, 320, 3), WALL, np.float32)
    mean[100:110, 150:160] = -1
    background.moving.start(mean, VIEW, 0.0)
    patch = draw(rng, noise=0.0)
    patch[102:128, 152:188] = (160, 150, 170)
    background.update(patch, VIEW, 0.1, [BOX])
    unknown = background.differs(draw(rng, noise=0.0), VIEW, WHOLE)
    assert unknown[101:109, 151:159].all()
    unknown[99:111, 149:161] = False
    assert not unknown.any()
    assert not background.moving.is_known
