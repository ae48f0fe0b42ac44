"""What resolution, triangles and light do to the image, against ray casting; and choosing by an error asked for."""

from dataclasses import replace

import numpy as np
import pytest

from pps_vision.experiments.films.exact import ray_cast
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.model import Robot
from pps_vision.types import Array
from rendering.eyes import Eyes
from rendering.fidelity import Fidelity
from rendering.scene import SceneState
from rendering.stimuli import RED, make_stimulus

PLACE = np.array([-0.36, -0.06, 0.12])


def drawn(robot: Robot, rig: StereoRig, state: SceneState, fidelity: Fidelity) -> Array:
    stimulus = make_stimulus("ball", fineness=fidelity.fineness)
    with Eyes(robot, rig, stimulus, fidelity=fidelity) as eyes:
        return eyes.render(state, 0.0).left.astype(float)


def test_each_refinement_comes_nearer_to_the_ray_cast_image(robot, rig, q):
    """Over the ball and the 2 px around it, and over the whole image; of eyes with pixels twice as large."""
    rig = replace(rig, left=rig.left.reduced(2), right=rig.right.reduced(2))
    state = SceneState(q, PLACE)
    ball = make_stimulus("ball")
    eye = rig.view(q).left
    exact = ray_cast(robot, eye, state, ball.radius_m, ball.parts[0].color, samples=3)
    sight = PLACE - eye.center
    distance = np.linalg.norm(sight)
    off_axis = np.arccos(eye.camera.bearing_map() @ (eye.T_root_camera[:3, :3].T @ sight / distance))
    near = off_axis < np.arcsin(ball.radius_m / distance) + 2 / eye.camera.focal_px

    def errors(fidelity: Fidelity) -> tuple[float, float]:
        square = (drawn(robot, rig, state, fidelity) - exact) ** 2
        return float(np.sqrt(square[near].mean())), float(np.sqrt(square.mean()))

    coarse = errors(Fidelity(fineness=1))
    usual = errors(Fidelity())
    fine = errors(Fidelity(scale=2))
    assert coarse[0] > 1.5 * usual[0]
    assert usual[0] > 1.5 * fine[0]
    assert usual[1] > 1.3 * fine[1]
    assert usual[0] < 7
    assert usual[1] < 5


@pytest.mark.parametrize(("lighting", "gamma", "diffuse"), [("baked", 1.0, 1.0), ("lights", 2.2, 0.96)])
def test_a_ball_is_lit_by_lamberts_law(robot, rig, q, lighting, gamma, diffuse):
    """Points of the ball: ambient light and three lamps, all of known direction; pyrender adds before it applies gamma,
    and of what a surface that is no metal reflects, glTF takes 4 % for highlights."""
    lamps = np.array([[0.474, 0.237, 0.848], [0.10, -0.81, 0.58], [-0.72, 0.45, 0.53]])
    strengths = diffuse * ((0.55 + np.array([0.38, 0.16, 0.12])) ** gamma - 0.55**gamma)
    eye = rig.view(q).left
    toward_eye = eye.center - PLACE
    toward_eye /= np.linalg.norm(toward_eye)
    image = drawn(robot, rig, SceneState(q, PLACE), Fidelity(fineness=4, lighting=lighting))
    for aside in (-0.5, 0.0, 0.5):  # relative to the radius
        normal = aside * eye.T_root_camera[:3, 0] + np.sqrt(1 - aside**2) * toward_eye
        normal /= np.linalg.norm(normal)
        u, v = np.rint(eye.project(PLACE + 0.035 * normal)).astype(int)
        assert (lamps @ normal)[0] > 0
        light = (0.55**gamma + np.maximum(lamps @ normal, 0) @ strengths) ** (1 / gamma)
        assert image[v, u] == pytest.approx(np.minimum(255 * light * np.array(RED), 255), abs=4)
