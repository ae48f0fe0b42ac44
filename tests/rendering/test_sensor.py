"""The sensor's noise and exposure, by their statistics."""

import numpy as np
import pytest

from pps_vision.types import Array
from rendering.sensor import Sensor, expose


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
