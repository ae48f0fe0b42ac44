"""The trigger on ray-cast scenes: quiet while only the head moves, quick when something else does."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from ball_scenes import Sphere, look
from ranges import check_range

from pps_vision.geometry.camera import Camera, StereoRig, View
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import LEFT_EYE, home, set_gaze
from pps_vision.robot.model import Robot
from tracking.motion_trigger import MotionTrigger, Region2D, TriggerParams

RED = (210.0, 45.0, 40.0)
DT = 0.05


def _gaze(robot: Robot, t: float, speed_rad_s: float) -> np.ndarray:
    return set_gaze(robot, home(robot), yaw=0.2 * np.sin(speed_rad_s / 0.2 * t), pitch=-0.1 + 0.4 * speed_rad_s * t)


@pytest.mark.parametrize("speed_deg_s", [10.0, 20.0])
def test_no_false_alarm_while_the_head_turns(
    robot: Robot, rig: StereoRig, rng: np.random.Generator, speed_deg_s: float
) -> None:
    trigger = MotionTrigger(TriggerParams(), LEFT_EYE)
    for k in range(40):
        view = rig.view(_gaze(robot, DT * k, np.deg2rad(speed_deg_s))).left
        assert trigger.step(look(view, [], rng), view, DT * k) == []


@pytest.mark.parametrize(("px_per_frame", "within"), [(5.0, 3), (1.0, 5)])
@pytest.mark.parametrize("speed_deg_s", [0.0, 10.0])
def test_a_moving_ball_is_found_within_frames(
    robot: Robot, rig: StereoRig, rng: np.random.Generator, px_per_frame: float, within: int, speed_deg_s: float
) -> None:
    trigger = MotionTrigger(TriggerParams(), LEFT_EYE)
    ahead = rig.view(_gaze(robot, 0.0, 0.0)).left.T_root_camera
    regions: list[Region2D] = []
    for k in range(6 + within):
        view = rig.view(_gaze(robot, DT * k, np.deg2rad(speed_deg_s))).left
        x = max(k - 5, 0) * px_per_frame * 0.5 / LEFT_EYE.fx
        center = (ahead @ np.array([x - 0.03, 0.0, 0.5, 1.0]))[:3]
        regions = trigger.step(look(view, [Sphere(center, 0.035, RED)], rng), view, DT * k)
        if k <= 5:
            assert regions == []  # it is there, but does not move yet
    true = view.project(center)
    assert regions
    x, y, w, h = regions[0].box_px
    assert np.linalg.norm([x + w / 2 - true[0], y + h / 2 - true[1]]) < 25


def test_ones_own_body_and_exposure_are_no_stimulus(robot: Robot, rig: StereoRig, rng: np.random.Generator) -> None:
    view = rig.view(home(robot)).left
    ahead = view.T_root_camera
    own = MotionTrigger(TriggerParams(), LEFT_EYE)
    open_eyes = MotionTrigger(TriggerParams(), LEFT_EYE)
    saw = 0
    for k in range(8):
        sphere = Sphere((ahead @ np.array([-0.05 + 0.01 * k, 0.0, 0.5, 1.0]))[:3], 0.03, RED)
        image = np.clip(look(view, [sphere], rng) * (1 + 0.02 * k), 0, 255).astype(np.uint8)
        ray = sphere.center - view.center
        arm = view.rays(np.stack(np.meshgrid(np.arange(320), np.arange(240)), axis=-1)) @ ray > 0.99 * np.linalg.norm(
            ray
        )
        assert own.step(image, view, DT * k, lambda arm=arm: arm) == []
        saw += len(open_eyes.step(image, view, DT * k))
    assert saw > 0


def test_an_image_that_is_filled_anew_changes_nothing_that_was_remembered() -> None:
    """A camera's driver may use one buffer for all images."""
    rng = np.random.default_rng(2)
    trigger = MotionTrigger(GATE, LEFT_EYE)
    regions = []
    buffer = np.empty((240, 320, 3), np.uint8)
    for k, film in enumerate(moving(100, 100, 20, 20, 200.0)):
        buffer[:] = drawn(film, rng)
        regions.append(trigger.step(buffer, FIXED, DT * k))
    assert not any(regions[:5])
    assert all(regions[5:])


# The gates, on drawn images: a still eye, a textured wall, patches (x, y, width, height, level).

FIXED = View(LEFT_EYE, transform())
GATE = TriggerParams(flow=False)
Patch = tuple[float, float, int, int, float]


def drawn(patches: list[Patch], rng: np.random.Generator, noise: float = 0.0) -> np.ndarray:
    wall = 90 + 8 * np.sin(np.arange(320) / 9) + 8 * np.cos(np.arange(240) / 7)[:, None]
    for x, y, w, h, level in patches:
        patch = np.zeros((240, 320), np.float32)
        patch[int(y) : int(y) + h, int(x) : int(x) + w] = 1
        patch = cv2.warpAffine(patch, np.array([[1, 0, x % 1], [0, 1, y % 1]], float), (320, 240))
        wall = wall + (level - 90) * patch
    image = wall[..., None] + noise * rng.standard_normal((240, 320, 3))
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def triggered(params: TriggerParams, films: list[list[Patch]], noise: float = 0.0) -> list[list[Region2D]]:
    trigger = MotionTrigger(params, LEFT_EYE)
    rng = np.random.default_rng(2)
    return [trigger.step(drawn(patches, rng, noise), FIXED, DT * k) for k, patches in enumerate(films)]


def moving(x: float, y: float, w: int, h: int, level: float, px: float = 5.0, frames: int = 8) -> list[list[Patch]]:
    """At rest for five images, then to the right."""
    return [[(x + px * max(k - 4, 0), y, w, h, level)] for k in range(frames)]


def test_only_the_central_part_is_looked_at() -> None:
    at_the_border = [[(280 - 5 * max(k - 4, 0), 231, 30, 9, 200.0)] for k in range(8)]
    assert not any(triggered(GATE, at_the_border))
    assert any(triggered(replace(GATE, central=1.0), at_the_border))
    at_the_side = [[(309, 100 + 5 * max(k - 4, 0), 11, 30, 200.0)] for k in range(8)]
    assert not any(triggered(GATE, at_the_side))
    assert any(triggered(replace(GATE, central=1.0), at_the_side))
    for patch in ((0, 100, 40, 30, 200.0), (100, 0, 30, 40, 200.0)):  # of what begins at the border, the rest
        (region,) = triggered(GATE, [[]] * 5 + [[patch]])[-1]
        assert (
            min(region.box_px[0] - (12 if patch[0] == 0 else 100), region.box_px[1] - (10 if patch[1] == 0 else 100))
            >= -2
        )


def test_what_is_too_small_is_no_region() -> None:
    film = moving(100, 100, 5, 5, 200.0)
    assert any(triggered(GATE, film))
    assert not any(triggered(replace(GATE, min_area_px=150), film))
    assert not any(triggered(GATE, moving(100, 100, 1, 1, 160.0)))
    beside = [[]] * 5 + [[(100, 100, 20, 20, 200.0), (135, 110, 2, 2, 150.0)]]
    assert [len(triggered(params, beside)[-1]) for params in (GATE, replace(GATE, min_area_px=8))] == [1, 2]


def test_parts_of_one_object_are_joined_and_the_strongest_comes_first() -> None:
    parts = [[]] * 5 + [[(100, 100, 20, 10, 130.0), (100, 116, 20, 10, 130.0), (200, 60, 12, 12, 200.0)]]
    regions = triggered(GATE, parts)[-1]
    assert len(regions) == 2
    assert regions[0].evidence >= regions[1].evidence > 0
    assert len(triggered(replace(GATE, join_px=1), parts)[-1]) == 3
    bright = [[]] * 5 + [[(100, 60, 12, 12, 110.0), (200, 100, 12, 12, 200.0)]]
    assert [region.box_px[0] > 150 for region in triggered(GATE, bright)[-1]] == [True, False]


def test_a_slow_object_is_found_in_the_turns_of_the_long_interval() -> None:
    slow = moving(100, 100, 20, 20, 200.0, 0.14, 20)
    regions = triggered(GATE, slow)
    assert not any(regions[:9])
    assert any(regions)
    assert not any(triggered(replace(GATE, slow_interval_s=GATE.interval_s), slow))
    flows = [
        regions_of_step[0].flow
        for regions_of_step in triggered(TriggerParams(), moving(100, 100, 20, 20, 200.0, 0.3, 18))
        if regions_of_step
    ]
    assert any(flow is not None and flow.interval_s > 0.5 for flow in flows)


def test_where_the_robot_was_is_no_stimulus_either() -> None:
    rng = np.random.default_rng(2)
    arm: Patch = (100, 100, 30, 30, 200.0)
    mask = np.zeros((240, 320), bool)
    mask[98:132, 98:132] = True
    for own, expected in ((mask, 0), (np.zeros_like(mask), 1)):
        trigger = MotionTrigger(GATE, LEFT_EYE)
        regions = []
        for k in range(7):
            is_visible = k < 5
            body = own if is_visible else np.zeros_like(mask)
            regions = trigger.step(drawn([arm] if is_visible else [], rng), FIXED, DT * k, lambda body=body: body)
        assert len(regions) == expected


def test_something_near_at_rest_is_no_stimulus_for_an_eye_that_shifts() -> None:
    rng = np.random.default_rng(4)
    eyes = [View(LEFT_EYE, transform(translation=(0.003 * k, 0.0, 0.0))) for k in range(9)]
    near = Sphere(np.array([0.0, 0.0, 0.3]), 0.03, RED)
    regions = {}
    for name, params in (("default", GATE), ("any parallax", replace(GATE, max_parallax_px=1e3, near_m=1.0))):
        trigger = MotionTrigger(params, LEFT_EYE)
        regions[name] = [trigger.step(look(eye, [near], rng), eye, DT * k) for k, eye in enumerate(eyes)]
    assert not any(regions["default"])
    assert any(regions["any parallax"])


def test_an_eye_that_shifts_fast_compares_a_younger_image() -> None:
    rng = np.random.default_rng(4)
    eyes = [View(LEFT_EYE, transform(translation=(0.004 * k, 0.0, 0.0))) for k in range(9)]  # 4 px an image at 0.22 m
    for limit, expected in ((5.0, False), (100.0, True)):  # what appeared two images ago and rests
        trigger = MotionTrigger(replace(GATE, max_parallax_px=limit), LEFT_EYE)
        regions = []
        for k, eye in enumerate(eyes):
            spheres = [Sphere(np.array([0.02, 0.0, 0.6]), 0.04, RED)] if k >= 6 else []
            regions.append(bool(trigger.step(look(eye, spheres, rng), eye, DT * k)))
        assert regions[6]
        assert regions[8] == expected


# Confirmation by flow.


def textured(rng: np.random.Generator, level: float = 100.0) -> np.ndarray:
    return cv2.GaussianBlur(rng.uniform(level - 100, level + 100, (240, 320, 1)), (0, 0), 2.0)[..., None].repeat(
        3, axis=2
    )


def test_what_the_object_uncovers_is_refuted_and_the_object_measured() -> None:
    rng = np.random.default_rng(6)
    wall = textured(rng)
    square = textured(rng, 150.0)[:24, :24]
    for params, confirm, expected in ((GATE, True, 2), (TriggerParams(), False, 2), (TriggerParams(), True, 1)):
        trigger = MotionTrigger(params, LEFT_EYE)
        regions = []
        for k in range(12):
            image = wall.copy()
            x = 60 + 10 * max(k - 4, 0)
            image[100:124, x : x + 24] = square
            regions.append(trigger.step(np.clip(image, 0, 255).astype(np.uint8), FIXED, DT * k, confirm=confirm))
        assert max(len(regions_of_step) for regions_of_step in regions[9:]) == expected
    flow = regions[11][0].flow
    assert flow is not None
    assert flow.interval_s == pytest.approx(DT)
    np.testing.assert_allclose(flow.velocity_px_s, (200, 0), atol=8)
    assert flow.now_px[0] > 110  # on the object, not where it was


def test_a_plain_object_is_confirmed_though_little_of_it_has_a_match() -> None:
    """Without texture only its edge shows flow; covered and uncovered pixels mostly have no match, others are at
    rest."""
    detected = []
    for seed in range(2):
        wall = cv2.GaussianBlur(np.random.default_rng(seed).uniform(0, 255, (240, 320)), (0, 0), 5.0)
        wall = 100 + 30 * (wall - wall.mean()) / wall.std()
        for radius, step_px in ((14, 3), (14, 5), (18, 3), (18, 5)):
            rng = np.random.default_rng(seed)
            trigger = MotionTrigger(TriggerParams(), LEFT_EYE)
            for k in range(8):
                image = wall[..., None].repeat(3, axis=2)
                at = 80 + step_px * max(k - 4, 0), 120
                cv2.circle(image, at, radius, (150, 100, 60), cv2.FILLED, cv2.LINE_AA)
                noisy = np.clip(image + 2 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)
                regions = trigger.step(noisy, FIXED, DT * k)
                detected += [bool(regions)] if k >= 5 else []
    assert np.mean(detected) > 0.7


def test_what_moves_too_fast_for_flow_is_found_without_it() -> None:
    rng = np.random.default_rng(6)
    wall = textured(rng)
    square = textured(rng, 150.0)[:16, :16]
    trigger = MotionTrigger(TriggerParams(), LEFT_EYE)
    regions = []
    for k in range(6):
        image = wall.copy()
        x = 60 + 90 * max(k - 4, 0)
        image[100:116, x : x + 16] = square
        regions = trigger.step(np.clip(image, 0, 255).astype(np.uint8), FIXED, DT * k)
    assert [region.flow for region in regions if region.box_px[0] > 120] == [None]


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
def test_parameters_outside_their_range_are_refused(
    name: str, refused: tuple[float, ...], taken: tuple[float, ...]
) -> None:
    check_range(TriggerParams, name, refused, taken, lambda value: f"{name}={value}.*rising positive intervals")


@pytest.mark.parametrize(("px", "flow", "does"), [(0, True, False), (3, True, True), (0, False, True)])
def test_a_mask_moves_if_most_of_its_points_do_or_flow_is_off(px: int, flow: bool, does: bool) -> None:
    rng = np.random.default_rng(6)
    wall = textured(rng)
    square = textured(rng, 150.0)[:24, :24]
    trigger = MotionTrigger(TriggerParams(flow=flow), LEFT_EYE)
    for k in range(4):
        image = wall.copy()
        x = 100 + px * k
        image[100:124, x : x + 24] = square
        trigger.remember(np.clip(image, 0, 255).astype(np.uint8), FIXED, DT * k)
    mask = np.zeros((60, 60), bool)
    mask[20 : 20 + 24, x - 80 : x - 80 + 24] = True
    assert trigger.moves(mask, (80, 80, 140, 140)) == does
    if flow:
        around = np.zeros((60, 60), bool)
        around[2:14, 2:50] = True
        assert not trigger.moves(around, (80, 80, 140, 140))


# The residual of a plane at a known distance, seen through a pinhole by an eye that shifts.

PINHOLE = Camera(320, 240, 220.0, 220.0, 159.5, 119.5)


def plane(distance_m: float, shift_m: float) -> np.ndarray:
    """The image of a wavy texture on a plane before an eye at x = `shift_m`; as fine in the image at any distance."""
    u, v = np.meshgrid(np.arange(320) - 159.5, np.arange(240) - 119.5)
    x = u + shift_m * 220 / distance_m
    y = v
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
def test_what_is_near_and_at_rest_has_no_residual_and_what_is_too_near_has(shift_m: float) -> None:
    """Through a window in a wall 1.2 m away another plane shows, parts of which the window's sides cover."""
    window = np.zeros((240, 320), bool)
    window[90:150, 120:200] = True
    for distance in (0.11, 0.22, 0.25, 0.3, 0.36, 0.45, 0.6, 0.9, 1.2, 3.0, 1e6):
        old, new = (np.where(window, plane(distance, x), plane(1.2, x)) for x in (0.0, shift_m))
        mask = changed(old, new, shift_m)
        side = int(np.ceil(shift_m * 220 / 0.22)) + 4
        inside = mask[94:146, 120 + side : 200 - side]
        if distance < 0.2:
            assert inside.mean() > 0.02
        else:
            assert not inside.any()
        assert not mask[:, :110].any()
        assert not mask[:, 210:].any()


def test_every_pixel_may_be_at_another_distance() -> None:
    """The middle of the window shows a near plane, the rest a far one: each leaves a residual at the other's."""
    window = np.zeros((240, 320), bool)
    near = abs(np.arange(240)[:, None] - 120) < 12
    window[90:150, 120:200] = True
    old, new = (np.where(window, np.where(near, plane(0.25, x), plane(3.0, x)), plane(1.2, x)) for x in (0.0, 0.006))
    assert not changed(old, new, 0.006)[94:146, 130:190].any()


def test_a_change_of_exposure_is_no_residual() -> None:
    wall = plane(1.2, 0.0).astype(float)
    patch = np.zeros_like(wall)
    patch[100:140, 140:180] = 30
    assert not changed(wall, wall + 12, 0.0).any()
    mask = changed(wall, wall + 12 + patch, 0.0)
    assert mask[104:136, 144:176].mean() > 0.3
    mask[96:144, 136:184] = False
    assert not mask.any()
