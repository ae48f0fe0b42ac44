"""Images of the rendered eyes against projective geometry and OpenCV."""

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.se3 import move_points, rotation_to
from pps_vision.types import Array, Image
from rendering.eyes import Eyes
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus

BALL_M = 0.035
PLACES = [(-0.32, -0.08, 0.12), (-0.40, 0.02, 0.16), (-0.36, -0.15, 0.02), (-0.45, -0.20, 0.12), (-0.30, 0.00, 0.10)]


def silhouette_center(camera: Camera, center_camera: Array, radius: float) -> Array:
    """Centre of the image of a sphere: its cone of tangents, sampled, projected by OpenCV."""
    distance = float(np.linalg.norm(center_camera))
    angle = np.arcsin(radius / distance)
    turn = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    rim = np.column_stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.full(2000, np.cos(angle))])
    rays = rim @ rotation_to(center_camera).T
    px = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.K, np.array(camera.distortion))[0]
    moments = cv2.moments(px.astype(np.float32))
    return np.array([moments["m10"], moments["m01"]]) / moments["m00"]


def difference(a: Image, b: Image) -> Array:
    return np.abs(a.astype(float) - b.astype(float)).max(axis=2)


def measured_center(with_ball: Image, without: Image) -> Array:
    """Centre of all that changed: the rest of the picture is the same to the bit."""
    v, u = np.nonzero(difference(with_ball, without) > 20)
    return np.array([u.mean(), v.mean()])


@pytest.mark.parametrize("lens", ["straight", "distorting"])
def test_a_sphere_appears_where_its_cone_of_tangents_projects(robot, rig, straight_rig, q, lens):
    used = rig if lens == "distorting" else straight_rig
    errors = []
    with Eyes(robot, used, make_stimulus("ball", BALL_M)) as eyes:
        empty = eyes.render(SceneState(q), 0.0)
        for place in PLACES:
            frame = eyes.render(SceneState(q, np.array(place)), 0.0)
            for side in ("left", "right"):
                view: View = getattr(used.view(q), side)
                expected = silhouette_center(view.camera, move_points(view.T_camera_root, place), BALL_M)
                errors.append(measured_center(getattr(frame, side), getattr(empty, side)) - expected)
    # a shift by half a pixel, the mistake to be made here, would be ten times this
    assert np.abs(np.mean(errors, axis=0)).max() < 0.05
    assert np.sqrt(np.mean(np.square(errors))) < 0.08


def test_the_same_state_and_seed_give_the_same_bits(robot, rig, q):
    sensor = Sensor(noise_sigma=2, shot=0.1, exposure=1.1, blur_s=0.02)
    state = SceneState(q, np.array(PLACES[0]), velocity=np.array([0.1, 0.0, 0.0]))
    with Eyes(robot, rig, make_stimulus("octopus"), "hand", sensor) as eyes:
        first = eyes.render(state, 0.0, np.random.default_rng(7))
        eyes.set_stimulus(make_stimulus("cube"))
        third = eyes.render(state, 0.0, np.random.default_rng(7))
        eyes.set_stimulus(make_stimulus("octopus"))
        again = eyes.render(state, 0.0, np.random.default_rng(7))
        unlike = eyes.render(state, 0.0, np.random.default_rng(8))
    with Eyes(robot, rig, make_stimulus("octopus"), "hand", sensor) as eyes:
        anew = eyes.render(state, 0.0, np.random.default_rng(7))
    for side in ("left", "right"):
        assert np.array_equal(getattr(first, side), getattr(again, side))
        assert np.array_equal(getattr(first, side), getattr(anew, side))
        assert not np.array_equal(getattr(first, side), getattr(third, side))
        assert not np.array_equal(getattr(first, side), getattr(unlike, side))
