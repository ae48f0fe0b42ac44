"""The search for a moving object in both eyes, on ray-cast scenes."""

from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace

import cv2
import numpy as np
import pytest
from ball_scenes import Sphere, frame

from pps_vision.geometry.camera import StereoRig, View
from pps_vision.robot.icub import home
from pps_vision.robot.model import Robot
from pps_vision.types import Image, StereoFrame
from tracking.acquisition import Acquisition, Candidate, SearchCounts, segment, vivid_parts
from tracking.foreground import Background, Foreground, ForegroundParams
from tracking.marker import MarkerParams, is_nearer_than_surroundings
from tracking.motion_trigger import Region2D, TriggerParams
from tracking.outline import Optics, Outline
from tracking.stereo import Association, StereoParams, camera_frames

DT = 0.05


class Search:
    """A search in which nothing is known yet, by a robot at home."""

    def __init__(self, rig: StereoRig, robot: Robot) -> None:
        self.counts: SearchCounts = Counter()
        self._rig = rig
        self._q = home(robot)
        self._view = rig.view(self._q)
        self._rng = np.random.default_rng(3)
        optics = Optics(rig.left), Optics(rig.right)
        self._backgrounds = Background(ForegroundParams(), rig.left), Background(ForegroundParams(), rig.right)
        self._acquisition = Acquisition(
            TriggerParams(), optics, self._backgrounds, None, lambda _: nullcontext(), self.counts
        )
        self._association = Association.untrained(StereoParams(), rig.left.width)

    def frame(self, k: int, *balls: Sphere) -> StereoFrame:
        return frame(self._rig, self._q, list(balls), DT * k, self._rng)

    def step(self, frame: StereoFrame, is_learned: bool = False) -> tuple[Candidate, Candidate] | None:
        """The candidates of a frame, which the backgrounds learn afterwards if it is."""
        cameras = camera_frames(frame, self._view)
        pair = self._acquisition.step(cameras, self._view, self._association)
        for camera, background in zip(cameras, self._backgrounds, strict=True):
            if is_learned:
                background.update(camera.image, camera.view, frame.stamp_s)
        return pair

    def find_marker(self, left: Image, right: Image, stamp_s: float = 0.0) -> tuple[Outline, Outline] | None:
        cameras = camera_frames(StereoFrame(left, right, stamp_s, stamp_s), self._view)
        return self._acquisition.find_marker(MarkerParams(), cameras, self._view, self._association)


@pytest.fixture
def search(rig: StereoRig, robot: Robot) -> Search:
    return Search(rig, robot)


def learned_from(picture: Callable[[], Image], view: View) -> Background:
    """The background of an eye at rest after twelve pictures."""
    background = Background(ForegroundParams(), view.camera)
    for k in range(12):
        background.update(picture(), view, DT * k)
    return background


def drawn(
    rng: np.random.Generator,
    *discs: tuple[int, int, int],
    edge: int = 0,
    level: float = 125.0,
    wall: tuple[float, float] = (60.0, 180.0),
) -> Image:
    """A wall of random squares and grey discs (x, y, radius) before it; pixels left of the column `edge` hide them."""
    image = np.kron(np.random.default_rng(0).uniform(*wall, (24, 32, 3)), np.ones((10, 10, 1)))
    y, x = np.mgrid[:240, :320]
    for u, v, r in discs:
        image[((x - u) ** 2 + (y - v) ** 2 < r * r) & (x >= edge)] = level
    return np.clip(image + 2 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)


def faint(rng: np.random.Generator, edge: int, *discs: tuple[int, int, int]) -> Image:
    return drawn(rng, *discs, edge=edge, level=145.0, wall=(70.0, 100.0))


def green(*boxes: tuple[int, int, int, int], color: tuple[int, int, int] = (25, 200, 40)) -> Image:
    """A grey wall with boxes (left, top, right, bottom) before it."""
    image = np.random.default_rng(5).integers(60, 120, (240, 320, 1), np.uint8).repeat(3, axis=2)
    for x0, y0, x1, y1 in boxes:
        image[y0:y1, x0:x1] = color
    return image


def test_a_ball_on_one_eye_s_line_of_sight_is_found(search, view):
    """A ball on the right eye's line of sight shifts in the left image only; in the right one it just grows."""
    for k in range(9):
        p = view.right.center + (0.45 - 0.012 * max(k - 4, 0)) * view.right.rays([150.0, 120.0])
        pair = search.step(search.frame(k, Sphere(p, 0.03, (210, 45, 40))))
        assert (pair is not None) == (k == 8)


def test_of_two_objects_that_move_the_one_with_more_residual_is_taken(search, view):
    """A small red and a large blue ball, both across the view."""
    across = view.left.T_root_camera[:3, 1]
    starts = [view.left.center + 0.4 * view.left.rays([u, 100.0]) for u in (80.0, 240.0)]
    taken_px = []
    for k in range(9):
        small, large = (start + 0.012 * max(k - 4, 0) * across for start in starts)
        balls = Sphere(small, 0.015, (210, 45, 40)), Sphere(large, 0.035, (40, 60, 210))
        pair = search.step(search.frame(k, *balls))
        taken_px += [pair[0].outline.center_px[0]] if pair else []
    assert taken_px
    assert np.abs(np.array(taken_px) - 240).max() < 1


@pytest.mark.parametrize(
    ("learned", "earlier_discs", "current_discs", "u", "is_detected"),
    [
        ([], [(100, 120, 20)], [(112, 120, 20)], 112, True),  # it entered, and moves
        ([], [(60, 120, 20)], [(160, 120, 20)], 160, True),  # the same, faster than its size
        ([(100, 120, 20)], [(100, 120, 20)], [(112, 120, 20)], 112, False),  # it overlaps the place where it stood
        ([(40, 120, 20)], [(150, 120, 20)], [(162, 120, 20)], 162, True),  # it has left that place
        ([], [(112, 120, 20)], [(112, 120, 20)], 112, False),  # it rests
        ([], [(100, 120, 20)], [(112, 120, 23)], 112, False),  # it overlaps the learned object
        ([], [(100, 120, 20), (220, 120, 30)], [(112, 120, 20)], 112, False),  # more is uncovered than it has left
        ([], [(110, 120, 20)], [(112, 120, 30)], 112, False),  # it grows, and uncovers nothing
        ([(80, 120, 18)], [(200, 120, 18)], [(212, 120, 18)], 80, False),  # the place that it has left
    ],
)
def test_what_moves_as_a_whole_before_a_background(learned, earlier_discs, current_discs, u, is_detected, rng, view):
    background = learned_from(lambda: drawn(rng, *learned), view.left)
    v, r = current_discs[0][1:]
    seed = np.zeros((120, 200), bool)
    seed[v - 60 - r : v - 60 + r, u - 60 - r : u - 60 + r] = True
    earlier, current = (drawn(rng, *discs) for discs in (earlier_discs, current_discs))
    foreground = Foreground(background, current, view.left, (earlier, view.left))
    mask, is_part = foreground.moved_mask(seed, (60, 60, 260, 180)) or (None, True)
    assert is_part != is_detected
    if is_detected:
        y, x = np.nonzero(mask)
        np.testing.assert_allclose((x.mean() + 60, y.mean() + 60), (u, v), atol=1.0)
        assert len(x) == pytest.approx(np.pi * r * r, rel=0.2)


def test_what_emerges_in_one_eye_is_found_where_the_other_sees_the_whole(search, view):
    """A grey ball of 20 px comes from behind something that hides it from the left eye only."""
    rng = np.random.default_rng(4)
    errors = []
    shares = []
    for k in range(24):
        p = view.left.center + 0.4 * view.left.rays([90.0 + 3 * max(k - 8, 0), 120.0])
        (u, v), (x, y) = (np.rint(eye.project(p)).astype(int).tolist() for eye in (view.left, view.right))
        right_edge = 320 if k < 9 else 0  # hidden, and out of the left eye's sight
        images = faint(rng, 112, (u, v, 20)), faint(rng, right_edge, (x, y, 20))
        pair = search.step(StereoFrame(*images, DT * k, DT * k), is_learned=True)
        if pair is not None:
            shares.append(pair[0].mask.sum() / pair[1].mask.sum())
            errors.append(pair[0].outline.center_px - (u, v))
    assert min(shares) < 0.75
    assert np.abs(errors).max() < 1.2


def test_what_has_not_changed_is_no_part_of_an_object_of_its_colour(rng, rig, view):
    """A red ball that begins to move before a red bar: the colour's region is both, what differs is a part."""
    y, x = np.mgrid[:240, :320]

    def picture(u: int) -> np.ndarray:
        image = drawn(rng).mean(axis=2, keepdims=True).astype(np.uint8).repeat(3, axis=2)
        image[138:160, 112:136] = (200, 30, 30)
        image[(x - u) ** 2 + (y - 120) ** 2 < 20**2] = (200, 30, 30)
        return image

    background = learned_from(lambda: picture(100), view.left)
    optics = Optics(rig.left)

    def segmented(earlier_x: int, x: int, left: int, is_compared: bool = True) -> Candidate | None:
        current = picture(x)
        region = Region2D((left, 100, 25, 30), np.ones((30, 25), bool), 1.0)
        earlier = picture(earlier_x), view.left
        foreground = Foreground(background, current, view.left, earlier) if is_compared else None
        return segment(current, region, optics, foreground)

    assert segmented(116, 124, 120, False).outline.box_px[3] > 55  # nothing but colour: the bar belongs to it
    part = segmented(116, 124, 120)
    assert not part.by_color
    assert part.is_partly_occluded
    free = segmented(172, 180, 170)  # away from the bar
    assert free.by_color
    assert free.outline.center_px == pytest.approx([180, 120], abs=0.5)


@pytest.mark.parametrize("wall", [(90, 90, 90), (250, 150, 80)], ids=["grey", "of its hue"])
def test_a_ball_in_a_hand_is_a_part_of_what_moves_also_where_it_overlaps_the_place_it_has_left(wall, rng, rig, view):
    """A red ball above a fist, in view from the start, before a wall."""
    y, x = np.mgrid[:240, :320]

    def picture(u: int) -> Image:
        image = np.broadcast_to(np.array(wall), (240, 320, 3)) + rng.normal(0, 2, (240, 320, 3))
        image[(x - u) ** 2 + (y - 120) ** 2 < 20**2] = (200, 30, 30)
        image[(abs(x - u) < 16) & (y > 130) & (y < 200)] = (175, 130, 105)
        return image.clip(0, 255).astype(np.uint8)

    background = learned_from(lambda: picture(100), view.left)
    current = picture(112)
    region = Region2D((80, 100, 52, 100), np.ones((100, 52), bool), 1.0)
    foreground = Foreground(background, current, view.left, (picture(104), view.left))
    (part,) = vivid_parts(current, region, Optics(rig.left), foreground)
    assert part.outline.center_px == pytest.approx([112, 120], abs=0.5)
    assert part.outline.area_px == pytest.approx(np.pi * 20**2, rel=0.05)


def test_an_object_of_which_one_eye_sees_a_part_is_where_the_other_sees_the_whole(search, view):
    """A ball comes into the right image after the left one: its size is known from there."""
    errors = []
    for k in range(22):
        p = view.right.center + 0.4 * view.right.rays([-35.0 + 2 * k, 120.0])
        pair = search.step(search.frame(k, Sphere(p, 0.02, (210, 45, 40))), is_learned=True)
        if pair is not None:
            errors.append(pair[1].outline.center_px - view.right.project(p))
            assert pair[1].outline.box_px[0] < 0  # goes on beyond the image
    assert len(errors) >= 2
    assert np.abs(errors).max() < 0.6  # ball radius: 22 px


@pytest.mark.parametrize(
    ("side", "shift", "refused"),
    [(20, 0, None), (23, 0, None), (26, 0, "rejected by size"), (16, 0, "rejected by size"), (20, 60, "epipolar")],
)
def test_two_markers_are_one_if_they_are_as_large_and_may_be_one_point(side, shift, refused, search, view):
    """A square of 20 px in the left image; in the right one a larger, a smaller, or a lower one."""
    images = []
    center = view.left.center + 0.4 * view.left.rays([160.0, 110.0])
    for eye, side_px, down in ((view.left, 20, 0), (view.right, side, shift)):
        u, v = np.rint(eye.project(center)).astype(int) - (side_px // 2, side_px // 2 - down)
        images.append(green((u, v, u + side_px, v + side_px)))
    search.find_marker(*images)
    counts = search.counts
    assert (counts["candidates_left"], counts["candidates_right"]) == (1, 1)
    said = [key for key, n in counts.items() if key.startswith("rejected by") and n]
    assert len(said) == (refused is not None)
    assert (refused or "") in "".join(said)
    assert counts["rejected since it did not move"] == (refused is None)


@pytest.mark.parametrize("moving_eyes", [(0, 1), (0,), (1,), ()])
def test_before_unknown_surroundings_the_marker_is_the_one_that_moves_in_both_images(moving_eyes, search, view):
    """Of two squares of 20 px at 0.4 m, one of which moves by 4 px an image."""
    for k in range(5):
        images = []
        for n, eye in enumerate((view.left, view.right)):
            corners = [
                np.rint(eye.project(view.left.center + 0.4 * view.left.rays([x, y]))).astype(int)
                for x, y in ((90, 80), (200, 140))
            ]
            corners[1][0] += 4 * k if n in moving_eyes else 0
            images.append(green(*((u, v, u + 20, v + 20) for u, v in corners)))
        pair = search.find_marker(*images, DT * k)
        assert search.counts["candidates_left"] == search.counts["candidates_right"] == 2 * (k + 1)
    assert (pair is not None) == (len(moving_eyes) == 2)
    if pair is not None:
        assert abs(pair[0].center_px[0] - (200 + 16 + 9.5)) < 2


@pytest.mark.parametrize(("right_color", "is_one"), [((210, 45, 40), True), ((40, 60, 210), False)])
def test_what_has_another_colour_in_the_other_eye_is_another_object(right_color, is_one, search, view):
    """A red ball that moves from the fifth frame on in the left image; at its place in the right one the same, or a
    blue one."""
    start = view.left.center + 0.4 * view.left.rays([160.0, 110.0])
    pairs = []
    for k in range(8):
        p = start + 0.012 * max(k - 4, 0) * view.left.T_root_camera[:3, 1]
        left, right = (search.frame(k, Sphere(p, 0.03, color)) for color in ((210, 45, 40), right_color))
        pairs.append(search.step(replace(left, right=right.right)))
    assert any(pairs) == is_one
    counts = search.counts
    assert counts["frames"] == 8
    assert counts["motion_left"] == counts["motion_right"] == 3
    assert counts["candidates_left"] == counts["candidates_right"] == 3
    assert (counts["rejected by colour"] > 0) == (not is_one)


@pytest.mark.parametrize(
    ("nearness", "is_drawn", "is_nearer"),
    [(0.9, True, False), (0.75, True, True), (0.06, True, True), (0.0, True, False), (0.06, False, False)],
)
def test_an_object_is_nearer_than_what_surrounds_it_from_a_fifth_on(nearness, is_drawn, is_nearer, rig, view):
    """A sphere of spots about the left eye, behind an object at 0.3 m; of 0 the right eye sees another one.  Where none
    is drawn, both outlines are patches of the sphere."""
    p = view.left.center + 0.3 * view.left.rays([160.0, 110.0])
    left = cv2.GaussianBlur(np.random.default_rng(7).uniform(0, 255, (240, 320, 3)), (0, 0), 2.0)
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
        if is_drawn:
            cv2.circle(left if eye is view.left else right, (round(u), round(v)), 10, (25, 170, 40), cv2.FILLED)
    association = Association.untrained(StereoParams(), rig.left.width)
    cameras = camera_frames(StereoFrame(left, right, 0.0, 0.0), view)
    assert is_nearer_than_surroundings(association, cameras, view, *outlines) == is_nearer
