"""Robots that deviate from ideal ones: are they what they are said to be?"""

import numpy as np
import pytest
from drawn_study import run_and_draw

from pps_vision.experiments.reach import deviations
from pps_vision.experiments.reach.deviations import DEVIATIONS, Deviations, samples
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub


@pytest.mark.parametrize("deviation", DEVIATIONS)
def test_the_eyes_of_the_deviating_head_meet_at_the_deviating_hand(deviation: str) -> None:
    bend, eyes = DEVIATIONS[deviation]
    found = samples(deviation, 300, np.random.default_rng(1))
    robot = load_icub()
    hand = robot.chain(robot.names.arm("right")[:4], "right_palm").positions(bend(found.arm_rad))[0]
    assert len(hand) > 50
    np.testing.assert_allclose(eyes.points(found.gaze_rad), hand, atol=1e-6)
    ideal = np.linalg.norm(fixation_points(robot, found.gaze_rad) - hand, axis=1)
    assert (np.median(ideal) > 1e-3) == ("neck" in deviation)


def test_the_study_states_each_method(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deviations, "DEVIATIONS", {"none": DEVIATIONS["none"]})
    numbers, _ = run_and_draw(Deviations(seed=1, n=1, samples=90))
    exact, noisy = (numbers["noises"][noise]["none"]["structure alone"]["rmse_deg"][0] for noise in ("0", "1"))
    assert exact < noisy
