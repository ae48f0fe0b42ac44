"""An encounter through rendered eyes ends as without rendering."""

import numpy as np
import pytest

from pps_vision.app.encounters.encounter import draw
from pps_vision.app.encounters.kinematic import simulate_encounter
from pps_vision.app.encounters.registry import OURS, new_controller
from pps_vision.app.encounters.rendered import render_encounter
from pps_vision.app.encounters.tracks import track_of


@pytest.mark.long
def test_a_fast_ball_is_avoided_alike_with_and_without_rendering(scene, memories):
    balls = (draw(scene, "stop", 24 * k, 5) for k in range(20))  # left arm
    encounter = next(ball for ball in balls if ball.speed_m_s > 0.2)
    tracks = track_of(scene, encounter, np.random.default_rng(0))
    simulated = simulate_encounter(scene, memories["left"], encounter, OURS, new_controller(OURS), tracks)
    rendered = render_encounter(scene, memories["left"], encounter, 2.0, 5)
    assert rendered.touched == simulated.touched
    assert rendered.commands > 5
    assert abs(rendered.distance_m - simulated.distance_m) < 0.02
