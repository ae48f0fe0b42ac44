"""States that `render` draws: the object's path and the robot's own motion."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from control.fixation import fixation_error
from pps_vision.app.render import scene, stimulus_of
from pps_vision.app.render_params import RenderParams
from pps_vision.recordings.robot_file import robot_setup
from rendering.scene import SceneState

SETUP = robot_setup(None)


def states(seed: int = 1, **options: object) -> list[tuple[float, SceneState]]:
    params = {"stimulus": "ball", "motion": "circle", "out": Path("never"), "seconds": 0.5, "fps": 10.0} | options
    return list(scene(RenderParams(**params), SETUP, np.random.default_rng(seed)))  # type: ignore[arg-type]


def test_an_object_has_the_radius_asked_for() -> None:
    params = RenderParams("cube", "circle", Path("never"), radius=0.02)
    assert (stimulus_of(params, 0).name, stimulus_of(params, 0).radius_m) == ("cube", 0.02)


def test_frames_come_at_the_rate_and_for_the_time_asked_for() -> None:
    assert [t for t, _ in states()] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert [t for t, _ in states(seconds=0.01)] == [0.0], "at least one"


@pytest.mark.parametrize("fps", [5.0, 20.0])
def test_the_eyes_follow_the_object_while_the_head_sways(fps: float) -> None:
    """They begin on it; joints move on by their rates, and the object by its velocity."""
    rendered = states(seconds=2.0, fps=fps, speed=0.1)
    errors = [fixation_error(SETUP.robot.at(state.q_rad), state.position) for _, state in rendered]
    assert errors[0] < 1e-3
    assert np.rad2deg(max(errors)) < (1.5 if fps == 20 else 5)
    for (_, state), (_, following) in pairwise(rendered):
        assert state.dq_rad_s is not None
        np.testing.assert_allclose(following.q_rad, SETUP.robot.clamp(state.q_rad + state.dq_rad_s / fps), atol=1e-12)
        assert state.position is not None
        np.testing.assert_allclose(following.position, state.position + state.velocity / fps, atol=0.1 / fps)
    q = np.array([state.q_rad for _, state in rendered])
    assert np.ptp(q[:, SETUP.robot.indices(("neck_yaw",))[0]]) > np.deg2rad(3)


def test_a_head_that_is_still_does_not_move() -> None:
    rendered = states(head="still", center=(-0.4, 0.0, 0.25), seconds=0.3)
    assert all((state.q_rad == rendered[0][1].q_rad).all() and not state.dq_rad_s.any() for _, state in rendered)  # type: ignore[union-attr]
