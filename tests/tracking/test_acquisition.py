"""The search for a moving object in both eyes, on ray-cast scenes."""

from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext

import cv2
import numpy as np
import pytest
from ball_scenes import Sphere, frame

from pps_vision.geometry.camera import StereoRig, StereoView, View
from pps_vision.robot.icub import home
from pps_vision.robot.model import Robot
from pps_vision.types import Image, StereoFrame
from tracking.acquisition import (
    Acquisition,
    Candidate,
    SearchCounts,
    segment,
)
from tracking.background import Background
from tracking.ego_motion import EgoMotion
from tracking.foreground import StaticForeground
from tracking.marker import MarkerParams, find_markers
from tracking.marker_acquisition import is_nearer_than_surroundings, moved_markers
from tracking.motion_trigger import Region2D, TriggerParams
from tracking.outline import Optics, Outline
from tracking.stereo import Association, CameraFrame, StereoParams, camera_frames

DT = 0.05


class Search:
    """A search in which nothing is known yet."""

    def __init__(self, rig: StereoRig) -> None:
        self.counts: SearchCounts = Counter()
        optics = Optics(rig.left), Optics(rig.right)
        self._backgrounds = Background(EgoMotion(rig.left), 0.3), Background(EgoMotion(rig.right), 0.3)
        self._acquisition = Acquisition(
            TriggerParams(), optics, self._backgrounds, None, lambda _: nullcontext(), self.counts
        )
        self._association = Association.untrained(StereoParams(), rig.left.width)

    def step(self, frame: StereoFrame, view: StereoView) -> tuple[Candidate, Candidate] | None:
        return self._acquisition.step(camera_frames(frame, view), view, frame.stamp_s, self._association)

    def find_marker(self, frame: StereoFrame, view: StereoView) -> SearchCounts:
        cameras = camera_frames(frame, view)
        self._acquisition.find_marker(MarkerParams(), cameras, view, frame.stamp_s, self._association)
        return self.counts

    def learn(self, frame: StereoFrame, view: StereoView) -> None:
        for camera, background in zip(camera_frames(frame, view), self._backgrounds, strict=True):
            background.update(camera.image, camera.view, frame.stamp_s, None)


def learned_from(picture: Callable[[], Image], view: View) -> Background:
    """The background of an eye at rest after twelve pictures."""
    background = Background(EgoMotion(view.camera), 0.3)
    for k in range(12):
        background.update(picture(), view, DT * k, None)
    return background


def test_a_ball_on_one_eye_s_line_of_sight_is_found(robot: Robot, rig: StereoRig) -> None:
    """A ball on the right eye's line of sight shifts in the left image only; in the right one it just grows."""
    q = home(robot)
    view = rig.view(q)
    rng = np.random.default_rng(3)
    search = Search(rig)
    is_detected = []
    for k in range(9):
        p = view.right.center + (0.45 - 0.012 * max(k - 4, 0)) * view.right.rays([150.0, 120.0])
        stereo_frame = frame(rig, q, [Sphere(p, 0.03, (210, 45, 40))], DT * k, rng)
        pair = search.step(stereo_frame, view)
        is_detected.append(pair is not None)
    assert is_detected == [False] * 8 + [True]
    assert pair is not None
    assert pair[0].flow is not None
    assert pair[1].flow is not None
    std = np.sqrt(np.linalg.eigvalsh(pair[1].flow.cov)[-1])
    assert np.linalg.norm(pair[1].flow.velocity_px_s) < std  # it grows, but stays where it is


def test_of_two_objects_that_move_the_one_with_more_residual_is_taken(robot: Robot, rig: StereoRig) -> None:
    """A small red and a large blue ball, both across the view."""
    q = home(robot)
    rng = np.random.default_rng(3)
    view = rig.view(q)
    across = view.left.T_root_camera[:3, 1]
    starts = [view.left.center + 0.4 * view.left.rays([u, 100.0]) for u in (80.0, 240.0)]
    search = Search(rig)
    pairs = []
    for k in range(9):
        small, large = (start + 0.012 * max(k - 4, 0) * across for start in starts)
        balls = [Sphere(small, 0.015, (210, 45, 40)), Sphere(large, 0.035, (40, 60, 210))]
        stereo_frame = frame(rig, q, balls, DT * k, rng)
        pair = search.step(stereo_frame, view)
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
    ("learned", "earlier_discs", "current_discs", "is_detected"),
    [
        ([], [(100, 120, 20)], [(112, 120, 20)], True),  # it entered, and moves
        ([], [(60, 120, 20)], [(160, 120, 20)], True),  # the same, faster than its size
        ([(100, 120, 20)], [(100, 120, 20)], [(112, 120, 20)], False),  # it still overlaps the place where it stood
        ([(40, 120, 20)], [(150, 120, 20)], [(162, 120, 20)], True),  # it has left that place
        ([], [(112, 120, 20)], [(112, 120, 20)], False),  # it rests
        ([], [(100, 120, 20)], [(112, 120, 23)], False),  # it overlaps the learned object
        ([], [(100, 120, 20), (220, 120, 30)], [(112, 120, 20)], False),  # more is uncovered than it has left
        ([], [(110, 120, 20)], [(112, 120, 30)], False),  # it grows, and uncovers nothing
    ],
)
def test_what_moves_as_a_whole_before_a_background(
    learned: list[tuple[int, int, int]],
    earlier_discs: list[tuple[int, int, int]],
    current_discs: list[tuple[int, int, int]],
    is_detected: bool,
    rng: np.random.Generator,
    rig: StereoRig,
    robot: Robot,
) -> None:
    view = rig.view(home(robot)).left
    background = learned_from(lambda: drawn(rng, *learned), view)
    u, v, r = current_discs[0]
    box = (60, 60, 260, 180)
    seed = np.zeros((120, 200), bool)
    seed[v - 60 - r : v - 60 + r, u - 60 - r : u - 60 + r] = True
    mask = StaticForeground(background, view, drawn(rng, *earlier_discs), drawn(rng, *current_discs)).moved_mask(
        seed, box
    )
    assert (mask is not None) == is_detected
    if mask is not None:
        y, x = np.nonzero(mask)
        np.testing.assert_allclose((x.mean() + 60, y.mean() + 60), (u, v), atol=1.0)
        assert len(x) == pytest.approx(np.pi * r * r, rel=0.2)


def test_the_place_that_an_object_has_left_is_none(rng: np.random.Generator, rig: StereoRig, robot: Robot) -> None:
    view = rig.view(home(robot)).left
    background = learned_from(lambda: drawn(rng, (80, 120, 18)), view)
    seed = np.zeros((120, 120), bool)
    seed[40:80, 20:60] = True
    away = StaticForeground(background, view, drawn(rng, (200, 120, 18)), drawn(rng, (212, 120, 18)))
    assert away.moved_mask(seed, (40, 60, 160, 180)) is None


def behind(rng: np.random.Generator, edge: int, *discs: tuple[int, int, int]) -> np.ndarray:
    """A faintly textured wall with grey discs (x, y, radius); pixels left of the column `edge` hide them."""
    wall = np.kron(np.random.default_rng(0).uniform(70, 100, (24, 32, 3)), np.ones((10, 10, 1)))
    y, x = np.mgrid[:240, :320]
    for u, v, r in discs:
        wall[((x - u) ** 2 + (y - v) ** 2 < r * r) & (x >= edge)] = 145.0
    return np.clip(wall + 2 * rng.standard_normal(wall.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("learned", "earlier_discs", "current_discs", "is_detected"),
    [
        ([], [(96, 120, 20)], [(104, 120, 20)], True),  # it comes from behind what ends at 100
        ([], [(104, 120, 20)], [(104, 120, 20)], False),  # it rests there
        ([(96, 120, 20)], [(100, 120, 20)], [(112, 120, 20)], False),  # it still overlaps the place where it stood
        ([(116, 120, 15)], [(116, 120, 15)], [(200, 120, 15)], False),  # the place that it has left
    ],
)
def test_what_comes_from_behind_something_emerges(
    learned: list[tuple[int, int, int]],
    earlier_discs: list[tuple[int, int, int]],
    current_discs: list[tuple[int, int, int]],
    is_detected: bool,
    rng: np.random.Generator,
    rig: StereoRig,
    robot: Robot,
) -> None:
    view = rig.view(home(robot)).left
    background = learned_from(lambda: behind(rng, 100, *learned), view)
    seed = np.zeros((80, 80), bool)
    seed[20:60, 22:60] = True
    change = StaticForeground(background, view, behind(rng, 100, *earlier_discs), behind(rng, 100, *current_discs))
    mask = change.disoccluded_mask(seed, (80, 80, 160, 160))
    assert (mask is not None) == is_detected
    if mask is not None:
        assert change.moved_mask(seed, (80, 80, 160, 160)) is None  # it has not uncovered anything
        u, v, r = current_discs[0]
        y, x = np.mgrid[80:160, 80:160]
        assert np.mean(mask == (((x - u) ** 2 + (y - v) ** 2 < r * r) & (x >= 100))) > 0.97


@pytest.mark.parametrize(("u", "left", "is_detected"), [(20, 0, False), (40, 0, True), (40, 30, False)])
def test_what_the_image_or_the_searched_region_cuts_off_does_not_emerge(
    u: int, left: int, is_detected: bool, rng: np.random.Generator, rig: StereoRig, robot: Robot
) -> None:
    """A disc of 20 px that appears: at the image's border, inside, and across the border of the searched region."""
    view = rig.view(home(robot)).left
    background = learned_from(lambda: behind(rng, 0), view)
    seed = np.zeros((80, 80), bool)
    seed[35:45, u - left - 5 : u - left + 5] = True
    change = StaticForeground(background, view, behind(rng, 0), behind(rng, 0, (u, 120, 20)))
    assert (change.disoccluded_mask(seed, (left, 80, left + 80, 160)) is not None) == is_detected


def test_what_emerges_in_one_eye_is_found_where_the_other_sees_the_whole(robot: Robot, rig: StereoRig) -> None:
    """A grey ball of 20 px comes from behind something that hides it from the left eye only."""
    q = home(robot)
    rng = np.random.default_rng(4)
    view = rig.view(q)
    search = Search(rig)
    errors = []
    shares = []
    for k in range(24):
        p = view.left.center + 0.4 * view.left.rays([90.0 + 3 * max(k - 8, 0), 120.0])
        (u, v), (x, y) = (np.rint(eye.project(p)).astype(int).tolist() for eye in (view.left, view.right))
        hidden = k < 9  # and out of the left eye's sight
        left = behind(rng, 112, (u, v, 20))
        right = behind(rng, 320 if hidden else 0, (x, y, 20))
        stereo_frame = StereoFrame(left, right, DT * k, DT * k, q, q)
        pair = search.step(stereo_frame, view)
        search.learn(stereo_frame, view)
        if pair is not None:
            shares.append(pair[0].mask.sum() / pair[1].mask.sum())
            errors.append(pair[0].outline.center_px - (u, v))
    assert min(shares) < 0.75
    assert np.abs(errors).max() < 2.5


def test_what_has_not_changed_is_no_part_of_an_object_of_its_colour(
    rng: np.random.Generator, rig: StereoRig, robot: Robot
) -> None:
    """A red ball that begins to move before a red bar: the colour's region is both, and no object yet."""
    view = rig.view(home(robot)).left
    red = (200, 30, 30)
    y, x = np.mgrid[:240, :320]

    def picture(u: int) -> np.ndarray:
        image = drawn(rng).mean(axis=2, keepdims=True).astype(np.uint8).repeat(3, axis=2)
        image[138:160, 112:136] = red
        image[(x - u) ** 2 + (y - 120) ** 2 < 20**2] = red
        return image

    background = learned_from(lambda: picture(100), view)
    current_discs = picture(124)
    region = Region2D((120, 100, 25, 30), np.ones((30, 25), bool), 1.0)
    optics = Optics(rig.left)
    alone = segment(current_discs, region, optics)
    assert alone is not None
    assert alone.outline.box_px[3] > 55  # nothing but colour: the bar belongs to it
    assert (
        segment(current_discs, region, optics, StaticForeground(background, view, picture(116), current_discs)) is None
    )
    moved = picture(180)
    place = Region2D((170, 100, 25, 30), np.ones((30, 25), bool), 1.0)
    free = segment(moved, place, optics, StaticForeground(background, view, picture(172), moved))
    assert free is not None  # away from the bar
    assert free.by_color
    assert free.outline.center_px == pytest.approx([180, 120], abs=0.5)


def test_an_object_of_which_one_eye_sees_a_part_is_where_the_other_sees_the_whole(robot: Robot, rig: StereoRig) -> None:
    """A ball comes into the right image after the left one: its size is known from there."""
    q = home(robot)
    rng = np.random.default_rng(3)
    view = rig.view(q)
    search = Search(rig)
    errors = []
    for k in range(22):
        p = view.right.center + 0.4 * view.right.rays([-35.0 + 2 * k, 120.0])
        stereo_frame = frame(rig, q, [Sphere(p, 0.02, (210, 45, 40))], DT * k, rng)
        pair = search.step(stereo_frame, view)
        search.learn(stereo_frame, view)
        if pair is not None:
            errors.append(pair[1].outline.center_px - view.right.project(p))
            assert pair[1].outline.box_px[0] < 0  # goes on beyond the image
    assert len(errors) >= 2
    assert np.abs(errors).max() < 2.5  # ball radius: 22 px


@pytest.mark.parametrize(
    ("green", "taken"),
    [
        ((150, 30, 170, 50), True),
        ((0, 200, 320, 240), False),
        ((100, 30, 180, 50), False),
        ((150, 30, 190, 50), True),  # no more than twice as long as wide
        ((150, 30, 192, 50), False),
    ],
)
def test_a_marker_is_compact_and_whole(
    green: tuple[int, int, int, int], taken: bool, rng: np.random.Generator, rig: StereoRig, robot: Robot
) -> None:
    """A square is a marker; a meadow that the image cuts and a bar are none, before eyes that move."""
    view = rig.view(home(robot))
    x0, y0, x1, y1 = green
    image = rng.integers(60, 120, (240, 320, 1), np.uint8).repeat(3, axis=2)
    image[y0:y1, x0:x1] = (25, 200, 40)
    counts = Search(rig).find_marker(StereoFrame(image, image, 0.0, 0.0, home(robot), home(robot)), view)
    assert (counts["candidates_left"], counts["candidates_right"]) == ((1, 1) if taken else (0, 0))


def violet(box: tuple[int, int, int, int], hole: tuple[int, int, int, int] = (0, 0, 0, 0)) -> np.ndarray:
    """A grey wall with a violet box (left, top, right, bottom) before it, and a hole in that."""
    image = np.random.default_rng(5).integers(60, 120, (240, 320, 1), np.uint8).repeat(3, axis=2)
    was = image.copy()
    image[box[1] : box[3], box[0] : box[2]] = (120, 20, 220)
    image[hole[1] : hole[3], hole[0] : hole[2]] = was[hole[1] : hole[3], hole[0] : hole[2]]
    return image


@pytest.mark.parametrize(
    ("side", "shift", "refused"),
    [(20, 0, None), (23, 0, None), (26, 0, "rejected by size"), (16, 0, "rejected by size"), (20, 60, "epipolar")],
)
def test_two_markers_are_one_if_they_are_as_large_and_may_be_one_point(
    side: int, shift: int, refused: str | None, rng: np.random.Generator, rig: StereoRig, robot: Robot
) -> None:
    """A square of 20 px in the left image; in the right one a larger, a smaller, or a lower one."""
    view = rig.view(home(robot))
    images = []
    center = view.left.center + 0.4 * view.left.rays([160.0, 110.0])
    for eye, side_px, down in ((view.left, 20, 0), (view.right, side, shift)):
        u, v = np.rint(eye.project(center)).astype(int) - (side_px // 2, side_px // 2 - down)
        image = rng.integers(60, 120, (240, 320, 1), np.uint8).repeat(3, axis=2)
        image[v : v + side_px, u : u + side_px] = (25, 200, 40)
        images.append(image)
    counts = Search(rig).find_marker(StereoFrame(*images, 0.0, 0.0, home(robot), home(robot)), view)
    assert (counts["candidates_left"], counts["candidates_right"]) == (1, 1)
    said = [key for key, n in counts.items() if key.startswith("rejected by") and n]
    assert len(said) == (refused is not None)
    assert (refused or "") in "".join(said)
    assert counts["rejected since it did not move"] == (refused is None)


@pytest.mark.parametrize(("right_color", "is_one"), [((210, 45, 40), True), ((40, 60, 210), False)])
def test_what_has_another_colour_in_the_other_eye_is_another_object(
    right_color: tuple[int, int, int], is_one: bool, robot: Robot, rig: StereoRig
) -> None:
    """A red ball in the left image; at its place in the right one the same, or a blue one."""
    q = home(robot)
    pairs = []
    rng = np.random.default_rng(3)
    view = rig.view(q)
    search = Search(rig)
    start = view.left.center + 0.4 * view.left.rays([160.0, 110.0])
    for k in range(8):
        p = start + 0.012 * max(k - 4, 0) * view.left.T_root_camera[:3, 1]
        left, right = (frame(rig, q, [Sphere(p, 0.03, color)], DT * k, rng) for color in ((210, 45, 40), right_color))
        stereo_frame = StereoFrame(left.left, right.right, DT * k, DT * k, q, q)
        pairs.append(search.step(stereo_frame, view))
    assert any(pairs) == is_one
    assert search.counts["candidates_left"] > 0 < search.counts["candidates_right"]
    assert (search.counts["rejected by colour"] > 0) == (not is_one)


@pytest.mark.parametrize(
    ("box", "taken"),
    [
        ((0, 30, 20, 50), False),
        ((1, 30, 21, 50), True),
        ((30, 0, 50, 20), False),
        ((30, 1, 50, 21), True),
        ((300, 30, 320, 50), False),
        ((299, 30, 319, 50), True),
        ((30, 220, 50, 240), False),
        ((30, 219, 50, 239), True),
    ],
)
def test_of_what_the_images_border_cuts_the_size_is_unknown(
    box: tuple[int, int, int, int], taken: bool, rng: np.random.Generator, rig: StereoRig, robot: Robot
) -> None:
    """A green square at each border, or a pixel away from it."""
    view = rig.view(home(robot)).left
    image = rng.integers(60, 120, (240, 320, 1), np.uint8).repeat(3, axis=2)
    image[box[1] : box[3], box[0] : box[2]] = (25, 200, 40)
    camera = CameraFrame(image, view, 0.0, None)
    background = Background(EgoMotion(rig.left), 0.3)
    detections = moved_markers(MarkerParams(), camera, Optics(rig.left), background)
    assert len(detections) == taken


def green(*boxes: tuple[int, int, int, int], color: tuple[int, int, int] = (25, 200, 40)) -> Image:
    image = np.random.default_rng(5).integers(60, 120, (240, 320, 1), np.uint8).repeat(3, axis=2)
    for x0, y0, x1, y1 in boxes:
        image[y0:y1, x0:x1] = color
    return image


def test_before_an_eye_at_rest_a_marker_is_what_has_moved(rig: StereoRig, robot: Robot) -> None:
    """Detected in the image, or given as outlines; in front of a wall of its hue, by the foreground."""
    view = rig.view(home(robot)).left
    optics = Optics(rig.left)
    params = MarkerParams()
    resting = (60, 60, 80, 80)
    come = (150, 100, 170, 120)
    background = learned_from(lambda: green(resting), view)
    camera = CameraFrame(green(resting, come), view, 1.0, None)
    (marker,) = moved_markers(params, camera, optics, background)
    np.testing.assert_allclose(marker.center_px, [159.5, 109.5], atol=0.3)
    outlines_of_both = find_markers(params, camera.image, optics)
    assert len(outlines_of_both) == 2
    (again,) = moved_markers(params, camera._replace(outlines=outlines_of_both), optics, background)
    np.testing.assert_allclose(again.center_px, [159.5, 109.5], atol=0.3)
    wall = learned_from(lambda: green((0, 0, 320, 240), color=(60, 140, 75)), view)
    image = green((0, 0, 320, 240), color=(60, 140, 75))
    image[100:120, 150:170] = (25, 170, 40)
    (marker,) = moved_markers(params, camera._replace(image=image), optics, wall)
    np.testing.assert_allclose(marker.center_px, [159.5, 109.5], atol=0.5)


def test_what_the_search_has_met_is_counted(robot: Robot, rig: StereoRig) -> None:
    """A ball that moves from the fifth frame on."""
    q = home(robot)
    rng = np.random.default_rng(3)
    view = rig.view(q)
    search = Search(rig)
    for k in range(7):
        p = view.left.center + 0.4 * view.left.rays([160.0, 110.0 + 8 * max(k - 4, 0)])
        pair = search.step(frame(rig, q, [Sphere(p, 0.03, (210, 45, 40))], DT * k, rng), view)
    assert pair is not None
    assert pair[0].model.object is pair[1].model.object
    counts = search.counts
    assert counts["frames"] == 7
    assert counts["motion_left"] == counts["motion_right"] == 2
    assert counts["candidates_left"] == counts["candidates_right"] == 2


@pytest.mark.parametrize(
    ("nearness", "is_nearer"), [(1.0, False), (0.9, False), (0.75, True), (0.3, True), (0.06, True), (0.0, False)]
)
def test_an_object_is_nearer_than_what_surrounds_it_from_a_fifth_on(
    nearness: float, is_nearer: bool, rig: StereoRig, robot: Robot
) -> None:
    """A sphere of spots about the left eye, beside that of an object at 0.3 m; of 0 the right eye sees another one."""
    view = rig.view(home(robot))
    rng = np.random.default_rng(7)
    p = view.left.center + 0.3 * view.left.rays([160.0, 110.0])
    left = cv2.GaussianBlur(rng.uniform(0, 255, (240, 320, 3)), (0, 0), 2.0)
    left = np.clip((left - 127.5) * 4 + 127.5, 0, 255).astype(np.uint8)
    rows, columns = np.mgrid[:240, :320].reshape(2, -1)
    rays = view.right.rays(np.stack([columns, rows], axis=-1).astype(float))
    base = view.right.center - view.left.center
    along = rays @ base
    distance_m = -along + np.sqrt(along**2 - base @ base + (0.3 / max(nearness, 0.06)) ** 2)
    at = view.left.project(view.right.center + distance_m[:, None] * rays).astype(np.float32).reshape(240, 320, 2)
    right = np.asarray(cv2.remap(left, at, np.empty(0, np.float32), cv2.INTER_LINEAR), np.uint8)
    if nearness == 0.0:
        right = right[::-1, ::-1].copy()
    outlines = []
    for eye in (view.left, view.right):
        u, v = eye.project(p).tolist()
        box = (u - 10, v - 10, 20.0, 20.0)
        outlines.append(Outline(np.array([u, v]), 0.01 * np.eye(2), 10 / rig.left.focal_px, 1e-6, box, 314.0, False))
    cameras = camera_frames(StereoFrame(left, right, 0.0, 0.0), view)
    association = Association.untrained(StereoParams(), rig.left.width)
    assert is_nearer_than_surroundings(association, cameras, view, outlines[0], outlines[1]) == is_nearer
