"""The trigger on ray-cast scenes: quiet while only the head moves, quick when something else does."""

import numpy as np
import pytest
from raycast import ROOM_M, Sphere, look

from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import LEFT_EYE, home, set_gaze
from pps_vision.robot.model import Robot
from tracking.ego_motion import EgoMotion
from tracking.trigger import Region2D, Trigger, TriggerParams

RED = (210.0, 45.0, 40.0)
DT = 0.05


def _gaze(robot: Robot, t: float, speed_rad_s: float) -> np.ndarray:
    return set_gaze(robot, home(robot), yaw=0.2 * np.sin(speed_rad_s / 0.2 * t), pitch=-0.1 + 0.4 * speed_rad_s * t)


def test_an_older_image_looks_as_the_eye_would_see_it_now(robot: Robot, rig: StereoRig) -> None:
    then, now = (rig.view(_gaze(robot, t, 0.3)).left for t in (0.0, 0.3))
    ego = EgoMotion(LEFT_EYE)
    old, new = (look(view, []).mean(axis=2).astype(np.uint8) for view in (then, now))
    warped = ego.warp(old, then, now, 1 / ROOM_M)
    inside = np.s_[30:210, 40:280]
    assert np.abs(old[inside].astype(float) - new[inside]).mean() > 5
    assert np.abs(warped[inside].astype(float) - new[inside]).mean() < 2
    part = ego.warp(old, then, now, 1 / ROOM_M, (43, 31, 150, 98))
    np.testing.assert_array_equal(part, warped[31:98, 43:150])


@pytest.mark.parametrize("speed_deg_s", [10.0, 20.0])
def test_no_false_alarm_while_the_head_turns(
    robot: Robot, rig: StereoRig, rng: np.random.Generator, speed_deg_s: float
) -> None:
    trigger = Trigger(TriggerParams(), LEFT_EYE)
    for k in range(40):
        view = rig.view(_gaze(robot, DT * k, np.deg2rad(speed_deg_s))).left
        assert trigger.step(look(view, [], rng), view, DT * k) == []


@pytest.mark.parametrize(("px_per_frame", "within"), [(5.0, 3), (1.0, 5)])
@pytest.mark.parametrize("speed_deg_s", [0.0, 10.0])
def test_a_moving_ball_is_found_within_frames(
    robot: Robot, rig: StereoRig, rng: np.random.Generator, px_per_frame: float, within: int, speed_deg_s: float
) -> None:
    trigger = Trigger(TriggerParams(), LEFT_EYE)
    ahead = rig.view(_gaze(robot, 0.0, 0.0)).left.T_root_camera
    found: list[Region2D] = []
    for k in range(6 + within):
        view = rig.view(_gaze(robot, DT * k, np.deg2rad(speed_deg_s))).left
        x = max(k - 5, 0) * px_per_frame * 0.5 / LEFT_EYE.fx
        center = (ahead @ np.array([x - 0.03, 0.0, 0.5, 1.0]))[:3]
        found = trigger.step(look(view, [Sphere(center, 0.035, RED)], rng), view, DT * k)
        if k <= 5:
            assert found == []  # it is there, but does not move yet
    true = view.project(center)
    assert found
    x, y, w, h = found[0].box_px
    assert np.linalg.norm([x + w / 2 - true[0], y + h / 2 - true[1]]) < 25


def test_ones_own_body_and_exposure_are_no_stimulus(robot: Robot, rig: StereoRig, rng: np.random.Generator) -> None:
    view = rig.view(home(robot)).left
    ahead = view.T_root_camera
    own, open_eyes = Trigger(TriggerParams(), LEFT_EYE), Trigger(TriggerParams(), LEFT_EYE)
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


def test_an_image_that_was_only_remembered_is_compared_with(
    rig: StereoRig, robot: Robot, rng: np.random.Generator
) -> None:
    view = rig.view(home(robot)).left
    trigger = Trigger(TriggerParams(), LEFT_EYE)
    balls = [(view.T_root_camera @ np.array([0.01 * k, 0.0, 0.5, 1.0]))[:3] for k in range(2)]
    empty, first, second = (look(view, [Sphere(p, 0.03, RED)] if p is not None else [], rng) for p in (None, *balls))
    assert trigger.step(empty, view, 0.0, look=False) == []
    assert trigger.step(first, view, DT, look=False) == []
    assert len(trigger.step(second, view, 2 * DT)) == 1


def test_an_image_from_long_ago_is_forgotten(rig: StereoRig, robot: Robot, rng: np.random.Generator) -> None:
    view = rig.view(home(robot)).left
    trigger = Trigger(TriggerParams(), LEFT_EYE)
    trigger.step(look(view, [], rng), view, 0.0)
    center = (view.T_root_camera @ np.array([0.0, 0.0, 0.5, 1.0]))[:3]
    assert trigger.step(look(view, [Sphere(center, 0.03, RED)], rng), view, 10.0) == []


def test_bad_parameters_are_named() -> None:
    with pytest.raises(ValueError, match=r"central=1\.5"):
        TriggerParams(central=1.5)
