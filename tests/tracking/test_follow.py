"""Where one eye should see the object next, its image taken before or after the pair's stamp."""

from dataclasses import replace

import numpy as np
import pytest

from pps_vision.geometry.camera import StereoRig
from pps_vision.robot.icub import home
from pps_vision.robot.model import Robot
from pps_vision.types import Array
from tracking.eye import EyeParams
from tracking.follow import Follower
from tracking.kalman import Belief, KalmanParams, predict
from tracking.look import Look
from tracking.marker import MarkerParams
from tracking.outline import Optics, Outline

V = np.array([0.0, 0.5, 0.0])


@pytest.mark.parametrize("late_s", [-0.02, 0.0, 0.02])
def test_what_moves_is_expected_where_it_is_when_the_eye_looks(
    robot: Robot, rig: StereoRig, rng: np.random.Generator, late_s: float
) -> None:
    """50 cm/s across at 40 cm is 5 px in 20 ms; the eye's image is always as late as that."""
    view = rig.view(home(robot)).left
    start = (view.T_root_camera @ [0.0, 0.05, 0.4, 1.0])[:3]
    follower = Follower("left", Optics(rig.left), EyeParams(), MarkerParams(), 0.3, rng)
    image = np.zeros((240, 320, 3), np.uint8)

    def at(stamp_s: float) -> Array:
        return start + V * stamp_s

    def look(stamp_s: float) -> Look:
        return Look(image, view, stamp_s + late_s, None)

    belief = Belief(0.0, np.array([at(0.0), V]), 1e-8 * np.eye(6), np.zeros((3, 3)), 0.0)
    seen = Outline(view.project(at(late_s)), 0.01 * np.eye(2), 0.08, 1e-6, (100, 100, 35, 35), 900.0, False, 0.0)
    follower.remember(look(0.0), seen, belief)
    now = predict(KalmanParams(order=2), belief, 0.05)
    prior = follower.prior(look(0.05), belief, now)
    assert prior is not None
    np.testing.assert_allclose(prior.center_px, view.project(at(0.05 + late_s)), atol=0.1)
    prior = prior._replace(std_px=2.0)
    here, elsewhere = (replace(seen, center_px=prior.center_px + np.array([off, 0.0])) for off in (3.0, 60.0))
    found = follower.clear_object(prior, [elsewhere, here])
    assert found is not None
    assert found.outline is here
    assert follower.clear_object(prior, [elsewhere]) is None
