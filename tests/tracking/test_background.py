"""The background model on grey images drawn by hand: a wall of constant level, a brighter or darker patch, noise."""

import numpy as np
import pytest

from pps_vision.geometry.camera import View
from pps_vision.geometry.se3 import transform
from pps_vision.robot.icub import LEFT_EYE
from tracking.background import Background
from tracking.ego_motion import EgoMotion

VIEW = View(LEFT_EYE, transform())
PATCH = np.s_[100:130, 150:190]
BOX = (150.0, 100.0, 40.0, 30.0)


def grey(rng: np.random.Generator, level: float | None = None, wall: float = 100.0, noise: float = 2.0) -> np.ndarray:
    image = np.full((240, 320), wall)
    if level is not None:
        image[PATCH] = level
    return np.clip(image + noise * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)[..., None].repeat(3, 2)


@pytest.mark.parametrize("level", [60.0, 140.0])
def test_a_patch_that_was_not_there_differs_from_the_background(level: float, rng: np.random.Generator) -> None:
    background = Background(EgoMotion(LEFT_EYE), 0.3)
    assert not background.evidence(grey(rng), VIEW).any()  # nothing is known yet
    for k in range(10):
        background.learn(grey(rng), VIEW, 0.05 * k, [])
    evidence = background.evidence(grey(rng, level), VIEW)
    assert evidence[104:126, 154:186].min() == 1
    evidence[96:134, 146:194] = 0
    assert (evidence > 0.5).mean() < 1e-3


def test_the_background_follows_the_light_with_its_time_constant(rng: np.random.Generator) -> None:
    background = Background(EgoMotion(LEFT_EYE), 0.3)
    background.learn(grey(rng, noise=0), VIEW, 0.0, [])
    background.learn(grey(rng, 200.0, noise=0), VIEW, 0.3, [])
    expected = 100 + 100 * (1 - np.exp(-1))
    near, far = (
        background.evidence(grey(rng, level, noise=0), VIEW)[104:126, 154:186].max()
        for level in (np.rint(expected), expected + 8)
    )
    assert near < 0.5
    assert far == 1


def test_the_object_does_not_become_background(rng: np.random.Generator) -> None:
    held, taken = (Background(EgoMotion(LEFT_EYE), 0.3) for _ in range(2))
    for k in range(40):
        image = grey(rng, 160.0) if k else grey(rng)
        held.learn(image, VIEW, 0.05 * k, [BOX])
        taken.learn(image, VIEW, 0.05 * k, [])
    last = grey(rng, 160.0)
    assert held.evidence(last, VIEW)[PATCH].mean() > 0.9
    assert taken.evidence(last, VIEW)[PATCH].mean() < 0.5
    margin = np.zeros((240, 320), bool)  # 0.3 of the box beyond each of its sides is held too
    margin[92:138, 140:200] = True
    wall = grey(rng, wall=160.0)
    for k in range(40, 80):
        held.learn(wall, VIEW, 0.05 * k, [BOX])
    evidence = held.evidence(wall, VIEW)
    assert evidence[margin].min() > 0.9
    assert (evidence[~margin] > 0.5).mean() < 0.02


def test_noise_is_no_evidence(rng: np.random.Generator) -> None:
    background = Background(EgoMotion(LEFT_EYE), 0.3)
    for k in range(10):
        background.learn(grey(rng, noise=12.0), VIEW, 0.05 * k, [])
    assert (background.evidence(grey(rng, noise=12.0), VIEW) > 0.5).mean() < 0.002


def test_it_begins_anew_when_the_eye_moves(rng: np.random.Generator) -> None:
    background = Background(EgoMotion(LEFT_EYE), 0.3)
    moved = View(LEFT_EYE, transform(translation=(0.001, 0.0, 0.0)))
    for k in range(10):
        background.learn(grey(rng), VIEW, 0.05 * k, [])
    assert not background.evidence(grey(rng, 160.0), moved).any()
    background.learn(grey(rng, 160.0), moved, 0.5, [])
    assert background.evidence(grey(rng, 160.0), moved)[PATCH].mean() < 0.5
    assert not background.evidence(grey(rng, 160.0), VIEW).any()
