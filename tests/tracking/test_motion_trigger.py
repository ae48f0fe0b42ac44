"""The trigger on ray-cast scenes: quiet while only the head moves, quick when something else does."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import product

import cv2
import numpy as np
import pytest
from ball_scenes import Sphere, look
from ranges import check_range

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import LEFT_EYE, home, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Image
from tracking.motion_trigger import MotionTrigger, Region2D, TriggerParams

RED = (210.0, 45.0, 40.0)
DT = 0.05


def _gaze(robot: Robot, t: float, speed_rad_s: float) -> np.ndarray:
    return set_gaze(robot, home(robot), yaw=0.2 * np.sin(speed_rad_s / 0.2 * t), pitch=-0.1 + 0.4 * speed_rad_s * t)


@pytest.mark.parametrize("speed_deg_s", [10.0, 20.0])
def test_no_false_alarm_while_the_head_turns(robot, rig, rng, speed_deg_s):
    trigger = MotionTrigger(TriggerParams(), LEFT_EYE)
    for k in range(40):
        view = rig.view(_gaze(robot, DT * k, np.deg2rad(speed_deg_s))).left
        assert trigger.step(look(view, [], rng), view, DT * k) == []


@pytest.mark.parametrize(("px_per_frame", "within"), [(5.0, 3), (1.0, 5)])
@pytest.mark.parametrize("speed_deg_s", [0.0, 10.0])
def test_a_moving_ball_is_found_within_frames(robot, rig, rng, px_per_frame, within, speed_deg_s):
    trigger = MotionTrigger(TriggerParams(), LEFT_EYE)
    ahead = rig.view(_gaze(robot, 0.0, 0.0)).left.T_root_camera
    for k in range(6 + within):
        view = rig.view(_gaze(robot, DT * k, np.deg2rad(speed_deg_s))).left
        x = max(k - 5, 0) * px_per_frame * 0.5 / LEFT_EYE.fx
        center = (ahead @ np.array([x - 0.03, 0.0, 0.5, 1.0]))[:3]
        regions = trigger.step(look(view, [Sphere(center, 0.035, RED)], rng), view, DT * k)
        assert k > 5 or regions == []  # it is there, but does not move yet
    x, y, w, h = regions[0].box_px
    assert np.linalg.norm(view.project(center) - [x + w / 2, y + h / 2]) < 25


def test_ones_own_body_and_exposure_are_no_stimulus(rng, view):
    eye = view.left
    own, open_eyes = (MotionTrigger(TriggerParams(), LEFT_EYE) for _ in range(2))
    n_regions = 0
    for k in range(8):
        sphere = Sphere((eye.T_root_camera @ np.array([-0.05 + 0.01 * k, 0.0, 0.5, 1.0]))[:3], 0.03, RED)
        image = np.clip(look(eye, [sphere], rng) * (1 + 0.02 * k), 0, 255).astype(np.uint8)
        ray = sphere.center - eye.center
        rays = eye.rays(np.stack(np.meshgrid(np.arange(320), np.arange(240)), axis=-1))
        arm = rays @ ray > 0.99 * np.linalg.norm(ray)
        assert own.step(image, eye, DT * k, lambda arm=arm: arm) == []
        n_regions += len(open_eyes.step(image, eye, DT * k))
    assert n_regions > 0


# The gates, on drawn images: a still eye, a textured wall, patches (x, y, width, height, level).

FIXED = View(LEFT_EYE, transform())
GATE = TriggerParams(flow=False)
Patch = tuple[float, float, int, int, float]


def drawn(patches: list[Patch]) -> Image:
    wall = 90 + 8 * np.sin(np.arange(320) / 9) + 8 * np.cos(np.arange(240) / 7)[:, None]
    for x, y, w, h, level in patches:
        patch = np.zeros((240, 320), np.float32)
        patch[int(y) : int(y) + h, int(x) : int(x) + w] = 1
        patch = cv2.warpAffine(patch, np.array([[1, 0, x % 1], [0, 1, y % 1]], float), (320, 240))
        wall = wall + (level - 90) * patch
    return np.clip(np.rint(wall), 0, 255).astype(np.uint8)[..., None].repeat(3, axis=2)


def triggered(params: TriggerParams, films: list[list[Patch]]) -> list[list[Region2D]]:
    """Regions at each frame; the images come in one buffer, as a camera's driver may use it."""
    trigger = MotionTrigger(params, LEFT_EYE)
    buffer = np.empty((240, 320, 3), np.uint8)
    regions = []
    for k, patches in enumerate(films):
        buffer[:] = drawn(patches)
        regions.append(trigger.step(buffer, FIXED, DT * k))
    return regions


def moving(x: float, y: float, w: int, h: int, level: float, px: float = 5.0, frames: int = 8) -> list[list[Patch]]:
    """At rest for five images, then to the right."""
    return [[(x + px * max(k - 4, 0), y, w, h, level)] for k in range(frames)]


def test_a_slow_object_is_found_in_the_turns_of_the_long_interval():
    slow = moving(100, 100, 20, 20, 200.0, 0.14, 20)
    regions = triggered(GATE, slow)
    assert not any(regions[:9])
    assert any(regions)
    assert not any(triggered(replace(GATE, slow_interval_s=GATE.interval_s), slow))
    assert any(triggered(TriggerParams(), moving(100, 100, 20, 20, 200.0, 0.3, 18)))


def test_where_the_robot_was_is_no_stimulus_either():
    mask = np.zeros((240, 320), bool)
    mask[98:132, 98:132] = True
    for own, expected in ((mask, 0), (np.zeros_like(mask), 1)):
        trigger = MotionTrigger(GATE, LEFT_EYE)
        for k in range(7):  # the arm is in view in the first five
            body = own if k < 5 else np.zeros_like(mask)
            image = drawn([(100, 100, 30, 30, 200.0)] if k < 5 else [])
            regions = trigger.step(image, FIXED, DT * k, lambda body=body: body)
        assert len(regions) == expected


def shifting(params: TriggerParams, step_m: float, spheres: Callable[[int], list[Sphere]]) -> list[bool]:
    """Whether there is a region in each of nine images of an eye that shifts to the right."""
    rng = np.random.default_rng(4)
    trigger = MotionTrigger(params, LEFT_EYE)
    eyes = [View(LEFT_EYE, transform(translation=(step_m * k, 0.0, 0.0))) for k in range(9)]
    return [bool(trigger.step(look(eye, spheres(k), rng), eye, DT * k)) for k, eye in enumerate(eyes)]


def test_an_eye_that_shifts_fast_compares_a_younger_image():
    """By 4 px an image at 0.22 m: what appeared two images ago and rests is no stimulus any more."""
    sphere = Sphere(np.array([0.02, 0.0, 0.6]), 0.04, RED)
    for limit_px, expected in ((5.0, False), (100.0, True)):
        regions = shifting(replace(GATE, max_parallax_px=limit_px), 0.004, lambda k: [sphere] if k >= 6 else [])
        assert regions[6]
        assert regions[8] == expected


# Confirmation by flow.


def textured(rng: np.random.Generator, level: float = 100.0) -> Image:
    return cv2.GaussianBlur(rng.uniform(level - 100, level + 100, (240, 320, 1)), (0, 0), 2.0)[..., None].repeat(3, 2)


def square_at(xs: Iterable[int], size: int) -> list[Image]:
    """Images of a textured square at these columns before a textured wall."""
    rng = np.random.default_rng(6)
    wall = textured(rng)
    square = textured(rng, 150.0)[:size, :size]
    images = []
    for x in xs:
        image = wall.copy()
        image[100 : 100 + size, x : x + size] = square
        images.append(np.clip(image, 0, 255).astype(np.uint8))
    return images


def test_what_the_object_uncovers_is_refuted():
    images = square_at([60 + 10 * max(k - 4, 0) for k in range(12)], 24)
    for params, confirm, expected in ((GATE, True, 2), (TriggerParams(), False, 2), (TriggerParams(), True, 1)):
        trigger = MotionTrigger(params, LEFT_EYE)
        regions = [trigger.step(image, FIXED, DT * k, confirm=confirm) for k, image in enumerate(images)]
        assert max(map(len, regions[9:])) == expected
    x, _, w, _ = regions[11][0].box_px
    assert x + 0.5 * w > 110  # on the object, not where it was


def test_a_plain_object_is_confirmed_though_little_of_it_has_a_match():
    """Without texture only its edge shows flow; covered and uncovered pixels mostly have no match, others are at
    rest."""
    is_detected = []
    for seed, radius, step_px in product((0, 1), (14, 18), (3, 5)):
        rng = np.random.default_rng(seed)
        wall = cv2.GaussianBlur(np.random.default_rng(seed).uniform(0, 255, (240, 320)), (0, 0), 5.0)
        wall = 100 + 30 * (wall - wall.mean()) / wall.std()
        trigger = MotionTrigger(TriggerParams(), LEFT_EYE)
        for k in range(8):
            image = wall[..., None].repeat(3, axis=2)
            at = 80 + step_px * max(k - 4, 0), 120
            cv2.circle(image, at, radius, (150, 100, 60), cv2.FILLED, cv2.LINE_AA)
            noisy = np.clip(image + 2 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)
            regions = trigger.step(noisy, FIXED, DT * k)
            is_detected += [bool(regions)] if k >= 5 else []
    assert np.mean(is_detected) > 0.7


@pytest.mark.parametrize(
    ("name", "refused", "taken"),
    [
        ("interval_s", (0.61, 0.0), (0.6, 0.01)),
        ("tolerance_px", (0.0,), (0.1,)),
        ("min_area_px", (0,), (1,)),
        ("central", (1.1, 0.0), (1.0, 0.1)),
        ("max_regions", (0,), (1,)),
        ("min_moving", (1.1, 0.0), (1.0,)),
    ],
)
def test_parameters_outside_their_range_are_refused(name, refused, taken):
    check_range(TriggerParams, name, refused, taken, lambda value: f"{name}={value}.*rising positive intervals")


# The residual of a plane at a known distance, seen through a pinhole by an eye that shifts.

PINHOLE = Camera(320, 240, 220.0, 220.0, 159.5, 119.5)


def plane(distance_m: float, shift_m: float) -> np.ndarray:
    """The image of a wavy texture on a plane before an eye at x = `shift_m`; as fine in the image at any distance."""
    x, y = np.meshgrid(np.arange(320) - 159.5 + shift_m * 220 / distance_m, np.arange(240) - 119.5)
    return np.rint(120 + 70 * np.sin(x / 1.8) * np.cos(y / 4) + 30 * np.sin(0.13 * x + 0.2 * y)).astype(np.uint8)


def changed(old: np.ndarray, new: np.ndarray, shift_m: float) -> np.ndarray:
    """(H, W) pixels of the motion regions of an eye that has shifted to the right between two grey images."""
    trigger = MotionTrigger(replace(GATE, max_parallax_px=1e3), PINHOLE)
    views = [View(PINHOLE, transform(translation=(x, 0.0, 0.0))) for x in (0.0, shift_m)]
    for k, (image, view) in enumerate(zip((old, new), views, strict=True)):
        regions = trigger.step(np.clip(image, 0, 255).astype(np.uint8)[..., None].repeat(3, 2), view, DT * k)
    mask = np.zeros(old.shape, bool)
    for region in regions:
        x, y, w, h = region.box_px
        mask[y : y + h, x : x + w] |= region.mask
    return mask


@pytest.mark.parametrize("shift_m", [0.003, 0.006])
def test_what_is_near_and_at_rest_has_no_residual_and_what_is_too_near_has(shift_m):
    """Through a window in a wall 1.2 m away another plane shows, parts of which the window's sides cover; or a near one
    in the middle and a far one around it: each leaves a residual at the other's distance."""
    window = np.zeros((240, 320), bool)
    window[90:150, 120:200] = True
    middle = abs(np.arange(240)[:, None] - 120) < 12
    side = int(np.ceil(shift_m * 220 / 0.22)) + 4
    distances = (0.11, 0.22, 0.25, 0.3, 0.36, 0.45, 0.6, 0.9, 1.2, 3.0, 1e6)
    for near, far in (*zip(distances, distances, strict=True), (0.25, 3.0)):
        inner = {x: np.where(middle, plane(near, x), plane(far, x)) for x in (0.0, shift_m)}
        mask = changed(*(np.where(window, inner[x], plane(1.2, x)) for x in inner), shift_m)
        inside = mask[94:146, 120 + side : 200 - side]
        assert inside.mean() > 0.02 if far < 0.2 else not inside.any()
        assert not mask[:, :110].any()
        assert not mask[:, 210:].any()


def test_a_change_of_exposure_is_no_residual():
    wall = plane(1.2, 0.0).astype(float)
    patch = np.zeros_like(wall)
    patch[100:140, 140:180] = 30
    assert not changed(wall, wall + 12, 0.0).any()
    mask = changed(wall, wall + 12 + patch, 0.0)
    assert mask[104:136, 144:176].mean() > 0.3
    mask[96:144, 136:184] = False
    assert not mask.any()
