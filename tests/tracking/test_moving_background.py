"""The background of an eye that turns before a wall of soft spots, a plain disc before it; both are drawn by hand.

Shares of an edge across which the background changes more than the image, on drawn discs.
"""

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import LEFT_EYE
from pps_vision.types import Image, Mask
from tracking.background import Background
from tracking.ego_motion import EgoMotion
from tracking.moving_background import MovingBackground, edge_of_background

DT = 0.1
RADIUS = 16
WHOLE = (0, 0, 320, 240)
WALL_M = 1.2
_SPOTS = np.random.default_rng(1).uniform(60, 190, (40, 60, 3)).astype(np.float32)
WALL = np.clip(cv2.resize(_SPOTS, (900, 600), interpolation=cv2.INTER_CUBIC), 0, 255)
_V, _U = np.mgrid[:240, :320]


def turned(k: int, deg: float = 1.0) -> View:
    """View k of an eye that turns by `deg` from one image to the next."""
    return View(LEFT_EYE, transform(cv2.Rodrigues(np.array([0.0, np.deg2rad(deg) * k, 0.0]))[0]))


def seen(
    view: View, rng: np.random.Generator, disc_px: tuple[float, float] | None = None, wall_m: float = WALL_M
) -> tuple[Image, Mask]:
    """The wall as seen from a view, with a white disc about a pixel; and where the disc is."""
    rays = view.rays(np.stack([_U, _V], axis=-1).reshape(-1, 2).astype(float)).reshape(240, 320, 3)
    at = ((rays[..., :2] / rays[..., 2:] + view.center[:2] / wall_m) * 400 + (450, 300)).astype(np.float32)
    image = cv2.remap(WALL, at, np.empty(0, np.float32), cv2.INTER_LINEAR)
    mask = np.zeros((240, 320), bool)
    if disc_px is not None:
        mask = (_U - disc_px[0]) ** 2 + (_V - disc_px[1]) ** 2 < RADIUS**2
        image[mask] = (235.0, 235.0, 225.0)
    noisy = image + 2 * rng.standard_normal(image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8), np.asarray(mask)


def overlap(mask: Mask, true: Mask) -> float:
    return float(np.count_nonzero(mask & true) / np.count_nonzero(mask | true))


def learned(rng: np.random.Generator, n: int, start: tuple[float, float] | None = None) -> Background:
    """The background of a turning eye after n images, a disc moving down from `start` by 8 px an image."""
    background = Background(EgoMotion(LEFT_EYE), 0.3)
    for k in range(n):
        disc_px = None if start is None else (start[0], start[1] + 8 * k)
        background.update(seen(turned(k), rng, disc_px)[0], turned(k), DT * k)
    return background


def test_what_comes_before_the_wall_is_no_background_though_the_eye_turns(rng):
    background = learned(rng, 12)
    assert not background.is_known(turned(12))
    image, disc = seen(turned(12), rng, (150.0, 120.0))
    box = (100, 70, 220, 180)
    part = background.moving.differs(image, turned(12), box)
    assert overlap(part, disc[70:180, 100:220]) > 0.85
    evidence = background.moving.evidence(image, turned(12), box)
    assert overlap(evidence > 0.5, disc[70:180, 100:220]) > 0.85


def test_an_eye_that_begins_to_move_knows_what_it_saw_at_rest(rng):
    background = Background(EgoMotion(LEFT_EYE), 0.3)
    for k in range(4):
        background.update(seen(turned(0), rng)[0], turned(0), DT * k)
    image, disc = seen(turned(1), rng, (150.0, 120.0))
    part = background.behind_moving_eye(turned(1), 4 * DT).differs(image, turned(1), (100, 70, 220, 180))
    assert overlap(part, disc[70:180, 100:220]) > 0.85


def test_nothing_moves_and_nothing_differs(rng):
    """Except at the side where new background comes into view; with a pose that is 1.5° off everything does."""
    background = learned(rng, 12)
    image, _ = seen(turned(12), rng)
    assert background.moving.differs(image, turned(12), (40, 10, 280, 230)).mean() < 1e-3
    assert background.moving.differs(image, turned(12, deg=1.125), (40, 10, 280, 230)).mean() > 0.1


def test_the_place_that_an_object_has_left_becomes_background(rng):
    """A disc is in view from the first image on; a second later its first place is none, and the disc still one."""
    background = learned(rng, 14, (150.0, 30.0))
    image, disc = seen(turned(14), rng, (150.0, 30.0 + 8 * 14))
    mask = background.moving.differs(image, turned(14), (20, 5, 280, 235))
    assert overlap(mask, disc[5:235, 20:280]) > 0.85


@pytest.mark.parametrize("wall_m", [0.5, 5.0])
def test_a_resting_wall_at_any_distance_is_background_of_an_eye_that_moves_sideways(wall_m, rng):
    """By 4 cm between the images that are kept: 18 px at 0.5 m, 2 px at 5 m, 7 px at the distance assumed at first."""
    background = MovingBackground(EgoMotion(LEFT_EYE))
    for k in range(12):
        view = View(LEFT_EYE, transform(translation=(0.008 * k, 0.0, 0.0)))
        image, _ = seen(view, rng, wall_m=wall_m)
        background.update(image, view, DT * k)
    assert background.differs(image, view, (60, 10, 260, 230)).mean() < 0.01


@pytest.mark.parametrize("is_object", [True, False])
def test_an_edge_that_only_the_background_has_tells_an_empty_place(is_object, rng):
    background = Background(EgoMotion(LEFT_EYE), 0.3)
    view = turned(3)
    at = (150.0, 120.0)
    background.moving.update(seen(turned(0), rng, None if is_object else at)[0], turned(0), 0.0, ())
    u, v = view.project(view.center + WALL_M * turned(0).rays(at))
    place = (_U - u) ** 2 + (_V - v) ** 2 < RADIUS**2
    image, _ = seen(view, rng, (u, v) if is_object else None)
    share = background.learned_edge(image, view, place, WHOLE)
    box = int(u) - 20, int(v) - 30, int(u) + 40, int(v) + 50
    part = place[box[1] : box[3], box[0] : box[2]]
    assert background.learned_edge(image, view, part, box) == pytest.approx(share, abs=0.02)
    assert share < 0.4 if is_object else share > 0.6


def test_the_tracked_object_s_place_is_kept(rng):
    """An object that rests for seconds before a turning eye is not learned while it is tracked."""
    background = learned(rng, 12)
    direction = turned(12).rays([150.0, 120.0])
    for k in range(12, 32):
        view = turned(24 - k if k > 18 else k)
        u, v = view.project(view.center + WALL_M * direction)
        image, disc = seen(view, rng, (u, v))
        background.update(image, view, DT * k, [(u - RADIUS, v - RADIUS, 2 * RADIUS, 2 * RADIUS)])
    box = (int(u) - 30, int(v) - 30, int(u) + 30, int(v) + 30)
    assert overlap(background.moving.differs(image, view, box), disc[box[1] : box[3], box[0] : box[2]]) > 0.85


@pytest.mark.parametrize(
    ("images", "is_object"),
    [
        (((0.0, False), (0.5, True)), True),  # it has come
        (((0.0, False), (0.5, True), (0.9, True)), True),
        (((0.0, False), (0.5, True), (1.0, True)), False),  # it was there half a second ago
        (((0.0, False), (0.4, True), (0.9, True)), True),  # an image before its time is left out
        (((0.0, False), (1.0, True)), True),
        (((0.0, False), (1.1, True)), False),  # the background is too old and is reset
    ],
)
def test_what_looks_the_same_half_a_second_later_rests(images, is_object, rng):
    """Images at these stamps of an eye at rest, some with a disc in the middle."""
    background = MovingBackground(EgoMotion(LEFT_EYE))
    at = (160.0, 120.0)
    for stamp_s, with_disc in images:
        background.update(seen(turned(0), rng, at if with_disc else None)[0], turned(0), stamp_s)
    image, disc = seen(turned(0), rng, at)
    share = background.differs(image, turned(0), WHOLE)[disc].mean()
    assert share > 0.95 if is_object else share < 0.05


def test_nothing_is_known_before_the_first_image(rng):
    """Then everything may be an object, and nothing is evidence of one; the same once it has been forgotten."""
    background = MovingBackground(EgoMotion(LEFT_EYE))
    box = (10, 10, 60, 40)
    image, _ = seen(turned(0), rng)
    for _ in range(2):
        assert not background.is_known
        assert background.differs(image, turned(0), box).all()
        assert not background.evidence(image, turned(0), box).any()
        background.update(image, turned(0), 0.0)
        assert not background.differs(image, turned(0), box).any()
        background.invalidate()


def test_what_an_object_hides_when_the_eye_comes_to_rest_is_known_from_before(rng):
    background = learned(rng, 12)
    at = (150.0, 120.0)
    share = turned(11)
    box = (at[0] - 20, at[1] - 20, 40.0, 40.0)
    for k in (12, 13):
        background.update(seen(share, rng, at)[0], share, DT * k, [] if box is None else [box])
    assert background.is_known(share)
    image, disc = seen(share, rng, at)
    assert (background.evidence(image, share, WHOLE) > 0.5)[disc].mean() > 0.9, "it is still no background"
    assert (background.evidence(seen(share, rng)[0], share, WHOLE) > 0.5)[disc].mean() < 0.05, "the wall behind it is"


DRAWN = (0, 0, 120, 90)


def disc(radius: int, level: float) -> tuple[Image, Mask]:
    """Image of a disc that is brighter than its surroundings by `level`; its mask."""
    mask = np.zeros((90, 120), np.uint8)
    cv2.circle(mask, (60, 45), radius, 1, cv2.FILLED)
    image = (100 + level * mask)[..., None].repeat(3, axis=2).astype(np.uint8)
    return image, mask.astype(bool)


@pytest.mark.parametrize(
    ("radius", "covered", "learned", "gain", "known_to", "share"),
    [
        # the stronger edge decides
        (20, 60, 0, 1.0, 120, 0.0),
        (20, 0, 60, 1.0, 120, 1.0),
        (20, 60, 50, 1.0, 120, 0.0),
        (20, 50, 60, 1.0, 120, 1.0),
        # 60 levels are as many as 50 under a light 1.2 times as bright
        (20, 60, 50, 1.1, 120, 0.0),
        (20, 60, 50, 1.3, 120, 1.0),
        # the left half of an edge of 80 px, and a fifth, where too few points of the edge are known
        (14, 0, 60, 1.0, 60, 1.0),
        (14, 0, 60, 1.0, 48, None),
    ],
)
def test_the_stronger_edge_decides_where_the_background_is_known(radius, covered, learned, gain, known_to, share):
    """All around a disc; also in a box, whose corner the mask begins at."""
    image, mask = disc(radius, covered)
    mean = disc(radius, learned)[0].astype(np.float32)
    mean[:, known_to:] = -1.0
    expected = share if share is None else pytest.approx(share, abs=0.05 if gain != 1.0 else 0.0)
    assert edge_of_background(image, mean, gain, mask, DRAWN) == expected
    assert edge_of_background(image, mean, gain, mask[20:70, 30:90].copy(), (30, 20, 90, 70)) == expected


def test_the_image_s_border_is_no_edge():
    """Half of a disc is in view: only edge points whose both sides lie in the image count."""
    image, mask = disc(20, 0)
    mean = disc(20, 60)[0].astype(np.float32)
    cut = np.s_[:, 60:]
    share = edge_of_background(image[cut].copy(), mean[cut].copy(), 1.0, mask[cut].copy(), (0, 0, 60, 90))
    assert share == 1.0
