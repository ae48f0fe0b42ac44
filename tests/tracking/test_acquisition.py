"""The search for a moving object in both eyes, on ray-cast scenes."""

from collections import Counter
from contextlib import nullcontext

import numpy as np
import pytest
from ball_scenes import Sphere, frame

from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import home
from pps_vision.robot.model import Robot
from pps_vision.types import StereoFrame
from tracking.acquisition import Acquisition, AcquisitionParams, Change, joined, segment
from tracking.background import Background
from tracking.ego_motion import EgoMotion
from tracking.marker import MarkerParams
from tracking.motion_trigger import Region2D
from tracking.outline import Optics
from tracking.stereo import Association, StereoParams, camera_frames

DT = 0.05


def test_a_ball_on_one_eye_s_line_of_sight_is_found(robot: Robot, rig: StereoRig) -> None:
    """A ball on the right eye's line of sight shifts in the left image only; in the right one it just grows."""
    q = home(robot)
    view = rig.view(q)
    optics = Optics(rig.left), Optics(rig.right)
    rng = np.random.default_rng(3)
    acquisition = Acquisition(AcquisitionParams(), optics, None, lambda _: nullcontext(), Counter())
    association = Association.untrained(StereoParams(), rig.left.width)
    backgrounds = Background(EgoMotion(rig.left), 0.3), Background(EgoMotion(rig.right), 0.3)
    found = []
    for k in range(9):
        p = view.right.center + (0.45 - 0.012 * max(k - 4, 0)) * view.right.rays([150.0, 120.0])
        one = frame(rig, q, [Sphere(p, 0.03, (210, 45, 40))], DT * k, rng)
        pair, regions = acquisition.step(camera_frames(one, view), view, DT * k, backgrounds, association)
        found.append(pair is not None)
    assert regions[0][0].flow is not None
    assert found == [False] * 8 + [True]
    assert pair is not None
    assert pair[1].flow is not None
    std = np.sqrt(np.linalg.eigvalsh(pair[1].flow.cov)[-1])
    assert np.linalg.norm(pair[1].flow.velocity_px_s) < std  # it grows, but stays where it is


def test_of_two_objects_that_move_the_one_with_more_residual_is_taken(robot: Robot, rig: StereoRig) -> None:
    """A small red and a large blue ball, both across the view."""
    q, rng = home(robot), np.random.default_rng(3)
    view = rig.view(q)
    across = view.left.T_root_camera[:3, 1]
    starts = [view.left.center + 0.4 * view.left.rays([u, 100.0]) for u in (80.0, 240.0)]
    optics = Optics(rig.left), Optics(rig.right)
    acquisition = Acquisition(AcquisitionParams(), optics, None, lambda _: nullcontext(), Counter())
    association = Association.untrained(StereoParams(), rig.left.width)
    backgrounds = Background(EgoMotion(rig.left), 0.3), Background(EgoMotion(rig.right), 0.3)
    pairs = []
    for k in range(9):
        small, large = (start + 0.012 * max(k - 4, 0) * across for start in starts)
        balls = [Sphere(small, 0.015, (210, 45, 40)), Sphere(large, 0.035, (40, 60, 210))]
        one = frame(rig, q, balls, DT * k, rng)
        pair, _ = acquisition.step(camera_frames(one, view), view, DT * k, backgrounds, association)
        pairs += [pair] if pair else []
    assert pairs
    for pair in pairs:
        assert abs(pair[0].outline.center_px[0] - 240) < 10


def drawn(rng: np.random.Generator, *discs: tuple[int, int, int]) -> np.ndarray:
    """A textured wall with grey discs (x, y, radius)."""
    wall = np.kron(np.random.default_rng(0).uniform(60, 180, (24, 32, 3)), np.ones((10, 10, 1)))
    y, x = np.mgrid[:240, :320]
    for u, v, r in discs:
        wall[(x - u) ** 2 + (y - v) ** 2 < r * r] = 125.0
    return np.clip(wall + 2 * rng.standard_normal(wall.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("learned", "then", "now", "seen"),
    [
        ([], [(100, 120, 20)], [(112, 120, 20)], True),  # it entered, and moves
        ([], [(60, 120, 20)], [(160, 120, 20)], True),  # the same, faster than its size
        ([(100, 120, 20)], [(100, 120, 20)], [(112, 120, 20)], False),  # it still overlaps the place where it stood
        ([(40, 120, 20)], [(150, 120, 20)], [(162, 120, 20)], True),  # it has left that place
        ([], [(112, 120, 20)], [(112, 120, 20)], False),  # it rests
    ],
)
def test_what_moves_as_a_whole_before_a_background(
    learned: list[tuple[int, int, int]],
    then: list[tuple[int, int, int]],
    now: list[tuple[int, int, int]],
    seen: bool,
    rng: np.random.Generator,
    rig: StereoRig,
    robot: Robot,
) -> None:
    view = rig.view(home(robot)).left
    background = Background(EgoMotion(rig.left), 0.3)
    for k in range(12):
        background.learn(drawn(rng, *learned), view, DT * k, None)
    (u, v, r), box = now[0], (60, 60, 260, 180)
    seed = np.zeros((120, 200), bool)
    seed[v - 60 - r : v - 60 + r, u - 60 - r : u - 60 + r] = True
    mask = Change(background, view, drawn(rng, *then), drawn(rng, *now)).moving(seed, box)
    assert (mask is not None) == seen
    if mask is not None:
        y, x = np.nonzero(mask)
        np.testing.assert_allclose((x.mean() + 60, y.mean() + 60), (u, v), atol=1.0)
        assert len(x) == pytest.approx(np.pi * r * r, rel=0.2)


def test_the_place_that_an_object_has_left_is_none(rng: np.random.Generator, rig: StereoRig, robot: Robot) -> None:
    view = rig.view(home(robot)).left
    background = Background(EgoMotion(rig.left), 0.3)
    for k in range(12):
        background.learn(drawn(rng, (80, 120, 18)), view, DT * k, None)
    seed = np.zeros((120, 120), bool)
    seed[40:80, 20:60] = True
    away = Change(background, view, drawn(rng, (200, 120, 18)), drawn(rng, (212, 120, 18)))
    assert away.moving(seed, (40, 60, 160, 180)) is None


def behind(rng: np.random.Generator, edge: int, *discs: tuple[int, int, int]) -> np.ndarray:
    """A faintly textured wall with grey discs (x, y, radius), of which what is left of `edge` (px) is hidden."""
    wall = np.kron(np.random.default_rng(0).uniform(70, 100, (24, 32, 3)), np.ones((10, 10, 1)))
    y, x = np.mgrid[:240, :320]
    for u, v, r in discs:
        wall[((x - u) ** 2 + (y - v) ** 2 < r * r) & (x >= edge)] = 145.0
    return np.clip(wall + 2 * rng.standard_normal(wall.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("learned", "then", "now", "seen"),
    [
        ([], [(96, 120, 20)], [(104, 120, 20)], True),  # it comes from behind what ends at 100
        ([], [(104, 120, 20)], [(104, 120, 20)], False),  # it rests there
        ([(96, 120, 20)], [(100, 120, 20)], [(112, 120, 20)], False),  # it still overlaps the place where it stood
        ([(116, 120, 15)], [(116, 120, 15)], [(200, 120, 15)], False),  # the place that it has left
    ],
)
def test_what_comes_from_behind_something_emerges(
    learned: list[tuple[int, int, int]],
    then: list[tuple[int, int, int]],
    now: list[tuple[int, int, int]],
    seen: bool,
    rng: np.random.Generator,
    rig: StereoRig,
    robot: Robot,
) -> None:
    view = rig.view(home(robot)).left
    background = Background(EgoMotion(rig.left), 0.3)
    for k in range(12):
        background.learn(behind(rng, 100, *learned), view, DT * k, None)
    seed = np.zeros((80, 80), bool)
    seed[20:60, 22:60] = True
    change = Change(background, view, behind(rng, 100, *then), behind(rng, 100, *now))
    mask = change.emerging(seed, (80, 80, 160, 160))
    assert (mask is not None) == seen
    if mask is not None:
        assert change.moving(seed, (80, 80, 160, 160)) is None  # it has not uncovered anything
        u, v, r = now[0]
        y, x = np.mgrid[80:160, 80:160]
        assert np.mean(mask == (((x - u) ** 2 + (y - v) ** 2 < r * r) & (x >= 100))) > 0.97


@pytest.mark.parametrize(("u", "left", "seen"), [(20, 0, False), (40, 0, True), (40, 30, False)])
def test_what_the_image_or_the_searched_region_cuts_off_does_not_emerge(
    u: int, left: int, seen: bool, rng: np.random.Generator, rig: StereoRig, robot: Robot
) -> None:
    """A disc of 20 px radius that appears: at the image's border, inside, and across the border of what is searched."""
    view = rig.view(home(robot)).left
    background = Background(EgoMotion(rig.left), 0.3)
    for k in range(12):
        background.learn(behind(rng, 0), view, DT * k, None)
    seed = np.zeros((80, 80), bool)
    seed[35:45, u - left - 5 : u - left + 5] = True
    change = Change(background, view, behind(rng, 0), behind(rng, 0, (u, 120, 20)))
    assert (change.emerging(seed, (left, 80, left + 80, 160)) is not None) == seen


def test_what_emerges_in_one_eye_is_found_where_the_other_sees_the_whole(robot: Robot, rig: StereoRig) -> None:
    """A grey ball of 20 px comes from behind something that hides it from the left eye only."""
    q, rng = home(robot), np.random.default_rng(4)
    view = rig.view(q)
    optics = Optics(rig.left), Optics(rig.right)
    acquisition = Acquisition(AcquisitionParams(), optics, None, lambda _: nullcontext(), Counter())
    association = Association.untrained(StereoParams(), rig.left.width)
    backgrounds = Background(EgoMotion(rig.left), 0.3), Background(EgoMotion(rig.right), 0.3)
    errors, shares = [], []
    for k in range(24):
        p = view.left.center + 0.4 * view.left.rays([90.0 + 3 * max(k - 8, 0), 120.0])
        (u, v), (x, y) = (np.rint(eye.project(p)).astype(int).tolist() for eye in (view.left, view.right))
        hidden = k < 9  # and out of the left eye's sight
        left, right = behind(rng, 112, (u, v, 20)), behind(rng, 320 if hidden else 0, (x, y, 20))
        one = StereoFrame(left, right, DT * k, DT * k, q, q)
        cameras = camera_frames(one, view)
        pair, _ = acquisition.step(cameras, view, DT * k, backgrounds, association)
        for camera, background in zip(cameras, backgrounds, strict=True):
            background.learn(camera.image, camera.view, DT * k, None)
        if pair is not None:
            shares.append(pair[0].mask.sum() / pair[1].mask.sum())
            errors.append(pair[0].outline.center_px - (u, v))
    assert min(shares) < 0.75
    assert np.abs(errors).max() < 2.5


@pytest.mark.parametrize(("apart_px", "is_one"), [(0, True), (12, False)])
def test_parts_of_two_colours_that_touch_are_one_object(
    apart_px: int, is_one: bool, rng: np.random.Generator, rig: StereoRig
) -> None:
    """A violet half above an orange one; a motion region in each."""
    image = rng.integers(60, 120, (240, 320, 1), np.uint8).repeat(3, axis=2)
    image[80:100, 140:180] = (120, 20, 220)
    image[100 + apart_px : 120 + apart_px, 140:180] = (240, 120, 10)
    params, optics = AcquisitionParams(), Optics(rig.left)
    regions = [Region2D((150, y, 20, 6), np.ones((6, 20), bool), 1.0) for y in (84, 106 + apart_px)]
    parts = [segment(params, image, region, optics) for region in regions]
    violet, orange = (part for part in parts if part is not None)
    found = joined(params, image, [violet, orange], optics)
    assert bool(found) == is_one
    if is_one:
        assert found[0].outline.center_px == pytest.approx([159.5, 99.5], abs=0.5)
        assert found[0].evidence == violet.evidence + orange.evidence


@pytest.mark.parametrize(("least_px", "is_one"), [(90, True), (110, False)])
def test_what_is_smaller_than_the_least_area_is_no_object(
    least_px: int, is_one: bool, rng: np.random.Generator, rig: StereoRig
) -> None:
    """A violet square of 100 px."""
    image = rng.integers(60, 120, (240, 320, 1), np.uint8).repeat(3, axis=2)
    image[100:110, 150:160] = (120, 20, 220)
    region = Region2D((150, 100, 10, 10), np.ones((10, 10), bool), 1.0)
    found = segment(AcquisitionParams(min_area_px=least_px), image, region, Optics(rig.left))
    assert (found is not None) == is_one


def test_what_has_not_changed_is_no_part_of_an_object_of_its_colour(
    rng: np.random.Generator, rig: StereoRig, robot: Robot
) -> None:
    """A red ball that begins to move before a red bar: the colour's region is both, and no object yet."""
    view, red = rig.view(home(robot)).left, (200, 30, 30)
    y, x = np.mgrid[:240, :320]

    def picture(u: int) -> np.ndarray:
        image = drawn(rng).mean(axis=2, keepdims=True).astype(np.uint8).repeat(3, axis=2)
        image[138:160, 112:136] = red
        image[(x - u) ** 2 + (y - 120) ** 2 < 20**2] = red
        return image

    background = Background(EgoMotion(rig.left), 0.3)
    for k in range(12):
        background.learn(picture(100), view, DT * k, None)
    now, region = picture(124), Region2D((120, 100, 25, 30), np.ones((30, 25), bool), 1.0)
    params, optics = AcquisitionParams(), Optics(rig.left)
    alone = segment(params, now, region, optics)
    assert alone is not None
    assert alone.outline.box_px[3] > 55  # nothing but colour: the bar belongs to it
    assert segment(params, now, region, optics, Change(background, view, picture(116), now)) is None


def test_an_object_of_which_one_eye_sees_a_part_is_where_the_other_sees_the_whole(robot: Robot, rig: StereoRig) -> None:
    """A ball comes into the right image after the left one: its size is known from there."""
    q, rng = home(robot), np.random.default_rng(3)
    view = rig.view(q)
    optics = Optics(rig.left), Optics(rig.right)
    acquisition = Acquisition(AcquisitionParams(), optics, None, lambda _: nullcontext(), Counter())
    association = Association.untrained(StereoParams(), rig.left.width)
    backgrounds = Background(EgoMotion(rig.left), 0.3), Background(EgoMotion(rig.right), 0.3)
    errors = []
    for k in range(22):
        p = view.right.center + 0.4 * view.right.rays([-35.0 + 2 * k, 120.0])
        one = frame(rig, q, [Sphere(p, 0.02, (210, 45, 40))], DT * k, rng)
        pair, _ = acquisition.step(camera_frames(one, view), view, DT * k, backgrounds, association)
        for camera, background in zip(camera_frames(one, view), backgrounds, strict=True):
            background.learn(camera.image, camera.view, DT * k, None)
        if pair is not None:
            errors.append(pair[1].outline.center_px - view.right.project(p))
            assert pair[1].outline.box_px[0] < 0  # goes on beyond the image
    assert len(errors) >= 2
    assert np.abs(errors).max() < 2.5  # of a ball of 22 px


@pytest.mark.parametrize(
    ("green", "taken"), [((150, 30, 170, 50), True), ((0, 200, 320, 240), False), ((100, 30, 180, 50), False)]
)
def test_a_marker_is_compact_and_whole(
    green: tuple[int, int, int, int], taken: bool, rng: np.random.Generator, rig: StereoRig, robot: Robot
) -> None:
    """A square is a marker; a meadow that the image cuts and a bar are none, before eyes that move."""
    view, (x0, y0, x1, y1) = rig.view(home(robot)), green
    image = rng.integers(60, 120, (240, 320, 1), np.uint8).repeat(3, axis=2)
    image[y0:y1, x0:x1] = (25, 200, 40)
    cameras = camera_frames(StereoFrame(image, image, 0.0, 0.0, home(robot), home(robot)), view)
    optics = Optics(rig.left), Optics(rig.right)
    unknown = Background(EgoMotion(rig.left), 0.3), Background(EgoMotion(rig.right), 0.3)
    counts: Counter[str] = Counter()
    association = Association.untrained(StereoParams(), rig.left.width)
    acquisition = Acquisition(AcquisitionParams(), optics, None, lambda _: nullcontext(), counts)
    acquisition.find_marker(MarkerParams(), cameras, view, 0.0, unknown, association)
    assert (counts["candidates_left"], counts["candidates_right"]) == ((1, 1) if taken else (0, 0))
