"""LWPR on the cross function, with part of the training points."""

import numpy as np
from drawn_study import run_and_draw

from learning.reach.babbling import babble
from pps_vision.experiments.reach.jamone import arm_model, hand_model
from pps_vision.experiments.reach.lwpr import SETTINGS, LwprCross, judge, train
from pps_vision.robot.gaze import GazeLimits
from pps_vision.robot.icub import icub_setup


def test_constant_metrics_come_near_the_authors_error_with_a_tenth_of_the_points() -> None:
    setting = SETTINGS["constant metrics"]
    model, update_us = train(setting, np.random.default_rng(1), share=0.1)
    assert judge(model)["nmse"] < 0.09
    assert update_us > 0


def test_study_draws_a_dot_per_model_and_a_range_per_setting() -> None:
    study = LwprCross(1, n=2, share=0.02)
    numbers, drawn = run_and_draw(study)
    assert set(numbers["settings"]) == set(SETTINGS)
    fields, time = drawn[""].axes
    shown = [label.get_text() for label in time.get_xticklabels()]
    assert {"2", "10", "20"} <= set(shown)
    assert len(fields.patches) == len(SETTINGS)
    assert all(len(line.get_xdata()) == 2 for line in fields.lines)


def test_points_beyond_the_limits_of_the_gaze_have_none() -> None:
    babbled = babble(icub_setup().robot, "right", 3000, np.random.default_rng(2))
    model = arm_model()
    model.learn(babbled.arm_rad, babbled.gaze_rad)
    hand = hand_model(model, babbled)
    limits = GazeLimits()
    shares = np.array([[0.5, 0.5, 0.5], [0.1, 0.9, 0.2], [0.5, 1.2, 0.5], [0.5, 0.5, 0.95], [1.1, 0.5, 0.5]])
    gaze = limits.lower + shares * (limits.upper - limits.lower)
    found = hand.gaze(hand.points(gaze), limits)
    within = [0, 1, 3]
    np.testing.assert_allclose(found[within], gaze[within], atol=1e-6)
    assert np.isnan(found[[2, 4]]).all()
