"""Motion blur against the exact displacement."""

import numpy as np
import pytest

from pps_vision.types import Array, Image
from rendering.eyes import Eyes
from rendering.scene import SceneState
from rendering.sensor import Sensor
from rendering.stimuli import make_stimulus

PLACE = np.array([-0.36, -0.06, 0.12])


def spread(image: Image, empty: Image) -> tuple[Array, Array]:
    """Centre (2,) and covariance (2, 2) of the green that was added to an empty scene, px."""
    greenness = [i[..., 1] - i[..., ::2].mean(axis=2) for i in (image.astype(float), empty.astype(float))]
    weight = greenness[0] - greenness[1]
    weight[weight < 8] = 0  # out of some 200
    px = np.argwhere(weight > 0)[:, ::-1]
    w = weight[weight > 0]
    center = w @ px / w.sum()
    return center, np.cov(px.T, aweights=w, ddof=0)


@pytest.mark.parametrize("length_px", [1.5, 6.0, 20.0])
def test_blur_is_as_long_as_the_motion_and_centred_on_the_stamp(robot, rig, q, length_px):
    eye = rig.view(q).left
    sideways = eye.T_root_camera[:3, 0]
    blur_s = 0.04
    speed = length_px / np.linalg.norm(eye.project_jacobian(PLACE) @ sideways) / blur_s
    state = SceneState(q, PLACE, velocity=speed * sideways)
    images = {}
    for name, sensor in (("sharp", Sensor()), ("blurred", Sensor(blur_s=blur_s))):
        with Eyes(robot, rig, make_stimulus("marker"), sensor=sensor) as eyes:
            images[name] = spread(eyes.render(state, 0.0).left, eyes.render(SceneState(q), 0.0).left)
    places = PLACE + np.outer(np.linspace(-0.5, 0.5, 101), speed * blur_s * sideways)
    path = eye.project(places)
    along = (path[-1] - path[0]) / np.linalg.norm(path[-1] - path[0])
    gained = images["blurred"][1] - images["sharp"][1]
    # a uniform smear of length L adds L²/12 to the variance along it and nothing across
    assert np.sqrt(12 * along @ gained @ along) == pytest.approx(length_px, rel=0.06, abs=0.2)
    across = np.array([-along[1], along[0]])
    assert abs(across @ gained @ across) < 0.3
    # where the lens and the distance show it larger it weighs more
    u, v = np.rint(path).astype(int).T
    area = 1 / (eye.camera.solid_angle_map()[v, u] * np.sum((places - eye.center) ** 2, axis=1))
    shift = images["blurred"][0] - images["sharp"][0] - (np.average(path, axis=0, weights=area) - path[50])
    assert np.linalg.norm(shift) < 0.10


def test_turning_the_head_blurs_the_room(robot, rig, q):
    turning = np.zeros(robot.n_joints)
    turning[robot.indices(("neck_yaw",))] = 0.5
    with Eyes(robot, rig, make_stimulus("ball"), sensor=Sensor(blur_s=0.05)) as eyes:
        still = eyes.render(SceneState(q), 0.0).left.astype(float)
        moving = eyes.render(SceneState(q, dq_rad_s=turning), 0.0).left.astype(float)
    loss = [np.abs(np.diff(moving, axis=a)).mean() / np.abs(np.diff(still, axis=a)).mean() for a in (0, 1)]
    assert loss[1] < 0.7  # along the motion, 5 px of it
    assert loss[0] > loss[1] + 0.1
