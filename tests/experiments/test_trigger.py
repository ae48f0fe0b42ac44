"""The trigger's study on recordings drawn by hand, where what moves, and when, is known to the pixel."""

import cv2
import numpy as np
import pytest

from pps_vision.experiments.baselines.motion import TRIGGERS, regions
from pps_vision.experiments.films.recordings import FPS, Footage
from pps_vision.experiments.study import Method
from pps_vision.experiments.trigger import (
    AFTER,
    DEFAULT,
    MISSED,
    STARTS,
    delay,
    methods,
)
from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import LEFT_EYE
from pps_vision.types import StereoFrame

RIG = StereoRig.fixed(LEFT_EYE, LEFT_EYE, np.eye(4))


def recording(px_per_frame: int, rng: np.random.Generator) -> Footage:
    """A textured square, 24 px wide, that starts at (150, 110) and moves to the right before a textured wall; both eyes
    see the same."""
    wall = cv2.blur(rng.uniform(60, 180, (240, 320, 3)), (3, 3))
    square = rng.uniform(200, 250, (24, 24, 3)) * (1.0, 0.9, 0.2)
    frames, position = [], []
    for k in range(STARTS + AFTER):
        x = 150 + px_per_frame * max(k - STARTS + 1, 0)
        image = wall.copy()
        image[98:122, x - 12 : x + 12] = square
        noisy = np.clip(image + rng.normal(0, 1, image.shape), 0, 255).astype(np.uint8)
        frames.append(StereoFrame(noisy, noisy, k / FPS, k / FPS, None, None))
        view = RIG.view_of(frames[-1]).left
        position.append(view.center + view.rays(np.array([x - 0.5, 109.5])))
    velocity = np.diff(np.array(position), axis=0, prepend=[position[0]]) * FPS
    seen, boxes = np.ones(len(frames), bool), ((None, None),) * len(frames)
    radius_m = 12 / LEFT_EYE.focal_px
    return Footage(tuple(frames), np.array(position), velocity, seen, boxes, radius_m, RIG, None)


@pytest.fixture(scope="module")
def calm() -> Footage:
    return recording(0, np.random.default_rng(4))


@pytest.fixture(scope="module")
def candidates(calm: Footage) -> dict[str, Method]:
    return methods(calm)


@pytest.mark.parametrize("name", [DEFAULT, "LK residual grid (R)", "DIS ultrafast − ego", "frame difference", "MOG2"])
def test_a_square_is_found_when_it_starts_and_not_before(
    name: str, calm: Footage, candidates: dict[str, Method]
) -> None:
    moving, method = recording(5, np.random.default_rng(5)), candidates[name]
    values = method(moving, 0)
    assert max(values["delay"]) <= 3
    assert len(values["ms"]) == 2 * (STARTS + AFTER)
    quiet = method(calm, 0)
    assert not np.any(quiet["alarm"])
    assert len(quiet["alarm"]) == 2 * AFTER


def test_what_is_elsewhere_or_never_is_missed() -> None:
    still = recording(0, np.random.default_rng(1))
    nothing: list[list[tuple[int, int, int, int]]] = [[] for _ in still.frames]
    assert delay(nothing, still, "left") == MISSED
    assert delay([*nothing[:-1], [(10, 10, 20, 20)]], still, "left") == MISSED
    assert delay([*nothing[:-1], [(150, 100, 20, 20)]], still, "left") == AFTER


def test_every_baseline_has_rising_levels(candidates: dict[str, Method]) -> None:
    assert set(candidates) >= set(TRIGGERS)
    for candidate in TRIGGERS.values():
        assert list(candidate.levels) == sorted(candidate.levels)


def test_regions_are_joined_and_small_ones_dropped() -> None:
    on = np.zeros((240, 320), bool)
    on[100:110, 100:110] = on[100:110, 114:120] = on[200, 200:210] = on[0:5, 0:50] = True
    assert regions(on) == [(100, 100, 20, 10)]  # 10 px are too few, and the border is not looked at
