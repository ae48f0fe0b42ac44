"""Images of the rendered eyes and their lenses against projective geometry and OpenCV."""

import cv2
import numpy as np
import pytest

from pps_vision.geometry.camera import Camera, View
from pps_vision.geometry.se3 import move_points, rotation_to
from pps_vision.robot.icub import LEFT_EYE, RIGHT_EYE
from pps_vision.types import Array, Image
from rendering.eyes import Eyes
from rendering.lens import Lens, pinholes
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


def test_a_lens_that_folds_the_image_back_is_refused():
    with pytest.raises(ValueError, match="expected a lens that can be undone over the whole image"):
        Lens(Camera(320, 240, 220.0, 220.0, 159.5, 119.5, (-1.0, 0.0, 0.0, 0.0, 0.0)))


@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_a_pinhole_image_holds_every_pixel_where_opencv_projects_from(scale):
    """Points of the pinhole image, projected by OpenCV, land on the pixels that the map takes from there."""
    lenses = [Lens(LEFT_EYE), Lens(RIGHT_EYE)]
    for lens, pinhole in zip(lenses, pinholes(lenses, scale), strict=True):
        whole, fraction = lens.map_to(pinhole)
        uv = whole + np.stack([fraction % 32, fraction // 32], axis=-1) / 32.0  # OpenCV's fixed point
        assert uv.min() >= 0
        assert uv.min(axis=(0, 1)).max() < scale + 1, "a margin of one of the lens's pixels, rounded up"
        assert uv[..., 0].max() <= pinhole.width - 1
        assert uv[..., 1].max() <= pinhole.height - 1
        xy = (uv - [pinhole.cx, pinhole.cy]) / [pinhole.fx, pinhole.fy]
        points = np.concatenate([xy.reshape(-1, 2), np.ones((uv[..., 0].size, 1))], axis=1)
        c = lens.camera
        px = cv2.projectPoints(points, np.zeros(3), np.zeros(3), c.K, np.array(c.distortion))[0].reshape(240, 320, 2)
        v, u = np.mgrid[:240, :320]
        assert np.abs(px - np.stack([u, v], axis=-1)).max() < 0.03
    assert len({(p.width, p.height) for p in pinholes(lenses, scale)}) == 1
