"""Independent eyes beside the rendered ones: the same states, the same truth, nearly the same pixels covered."""

from pathlib import Path

import numpy as np
import pytest

from control.fixation import gaze_at
from pps_vision.experiments.films.ray_cast_eyes import RayCastEyes
from pps_vision.robot.icub import home, icub_rig, load_icub
from rendering.eyes import Eyes
from rendering.scene import PropPose, SceneState
from rendering.shapes import board, sphere
from rendering.stimuli import BLUE, make_stimulus

pytestmark = pytest.mark.long
FACING = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def is_red(image: np.ndarray) -> np.ndarray:
    return (image[..., 0] > 60) & (image[..., 0] > 3.0 * image[..., 1]) & (image[..., 0] > 3.0 * image[..., 2])


def test_both_sources_show_the_same_state_at_the_same_pixels():
    """A ball half hidden by a board, a second ball beside it; the pixels of the first differ at its rim only."""
    robot = load_icub()
    rig, p = icub_rig(robot), np.array([-0.45, 0.02, 0.36])
    q = gaze_at(robot, home(robot), p)
    props = ((board(0.2, 0.2),), (sphere(0.02, BLUE),))
    nearer = PropPose(p + np.array([0.06, 0.1, 0.0]), rotation=FACING), PropPose(p + np.array([0.0, -0.06, 0.0]))
    state, ball = SceneState(q, p, props=nearer), make_stimulus("ball")
    with Eyes(robot, rig, ball, props=props) as eyes:
        theirs, their_truth = eyes.render(state, 0.0), eyes.truth(state, 0.0)
    ours = RayCastEyes(robot, rig, ball, props=props, data=Path("no such folder"))
    frame, truth = ours.render(state, 0.0, np.random.default_rng(0)), ours.truth(state, 0.0)
    np.testing.assert_allclose(truth.left_px, their_truth.left_px, atol=1e-3)
    np.testing.assert_allclose(truth.right_px, their_truth.right_px, atol=1e-3)
    assert (truth.visible_left, truth.visible_right) == (their_truth.visible_left, their_truth.visible_right)
    u, v = np.rint(truth.left_px).astype(int)
    window = np.s_[v - 30 : v + 30, u - 30 : u + 30]
    one, other = is_red(frame.left[window]), is_red(theirs.left[window])
    assert other.sum() > 300
    assert (one ^ other).sum() < 0.12 * other.sum()
    hidden = SceneState(q, p, props=(PropPose(p + np.array([0.06, 0.0, 0.0]), rotation=FACING),))
    assert not ours.truth(hidden, 0.0).visible_left
    assert np.isnan(ours.truth(SceneState(q), 0.0).left_px).all()
