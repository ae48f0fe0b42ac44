"""The sensor's noise and exposure by their statistics; motion blur against the exact displacement."""

import numpy as np
import pytest

from pps_vision.geometry.camera import solid_angles
from pps_vision.types import Array, Image
from rendering.eyes import Eyes
from rendering.scene import SceneState
from rendering.sensor import Sensor, expose
from rendering.stimuli import make_stimulus


def flat(level: float) -> Array:
    return np.full((240, 320, 3), level, np.float32)


def deviation(sensor: Sensor, level: float, seed: int = 0) -> Array:
    return expose(sensor, flat(level), np.random.default_rng(seed)).astype(float) - level


def test_a_sensor_with_everything_off_rounds():
    light = np.random.default_rng(0).uniform(0, 255, (240, 320, 3)).astype(np.float32)
    assert np.abs(expose(Sensor(), light, None) - light).max() <= 0.5
    assert Sensor() == Sensor(noise_sigma=0.0, shot=0.0, exposure=1.0, blur_s=0.0)


@pytest.mark.parametrize("sigma", [0.8, 2.0, 8.0])
def test_gaussian_noise_has_its_sigma_and_no_bias(sigma):
    error = deviation(Sensor(noise_sigma=sigma), 128)
    expected = np.sqrt(sigma**2 + 1 / 12)  # rounding to grey levels adds 1/12
    assert error.std() == pytest.approx(expected, rel=0.01)
    assert abs(error.mean()) < 4 * expected / np.sqrt(error.size)
    assert np.abs(np.corrcoef(error.reshape(-1, 3).T)[np.triu_indices(3, 1)]).max() < 0.02
    assert abs(np.corrcoef(error[:, :-1].ravel(), error[:, 1:].ravel())[0, 1]) < 0.02


def test_shot_noise_grows_with_the_light():
    variances = [deviation(Sensor(shot=0.2), level).var() - 1 / 12 for level in (40, 80, 160)]
    assert variances == pytest.approx([8, 16, 32], rel=0.03)


def test_exposure_is_a_gain_that_saturates():
    light = np.float32([[[10, 100, 200]]])
    assert expose(Sensor(exposure=1.5), light, None).tolist() == [[[15, 150, 255]]]
    assert expose(Sensor(exposure=0.5), light, None).tolist() == [[[5, 50, 100]]]


def test_a_noisy_sensor_asks_for_a_generator():
    with pytest.raises(ValueError, match="got None"):
        expose(Sensor(shot=0.1), flat(100), None)


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
    area = 1 / (solid_angles(eye.camera.bearing_map())[v, u] * np.sum((places - eye.center) ** 2, axis=1))
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
