"""Movements of R's sessions against geometry: exact, rendered, and by miscalibrated robots."""

import numpy as np
import pytest
from data import SEED

from pps_vision.app.encounters.robots import MiscalibratedRobot
from pps_vision.app.sessions import AIMED, movements
from pps_vision.experiments.pps.erring import errors_from, observe
from pps_vision.experiments.pps.session_trials import exact_trials, rendered_trials
from pps_vision.robot.icub import load_icub
from pps_vision.robot.skin import TOUCH_RADIUS_M, icub_skin

ROBOT = load_icub()
SKIN = icub_skin()


def rng(k: int = 0) -> np.random.Generator:
    return np.random.default_rng((SEED, k))


@pytest.mark.parametrize("name", ["motor", "inner", "outer", "palm"])
def test_a_trial_ends_in_its_touch(name):
    part, _ = AIMED[name]
    on_part = np.array([taxel.startswith(part) for taxel in SKIN.taxel_ids])
    for trial in exact_trials(name, 2, SEED):
        taxels = np.array([SKIN.at(ROBOT.at(q))[0] for q in trial.joints_rad])
        gaps = np.linalg.norm(taxels - trial.positions[:, None], axis=2) - trial.radius_m[:, None]
        np.testing.assert_array_equal(gaps[-1] <= TOUCH_RADIUS_M, trial.touched)
        assert trial.touched[on_part].any()
        assert gaps.min() > -0.006  # no object penetrates the skin
        assert gaps[0, on_part].min() > 0.10  # it starts beyond most of the receptive field
        mean = 0.5 * (trial.velocities[1:] + trial.velocities[:-1])
        np.testing.assert_allclose(np.diff(trial.positions, axis=0), 0.05 * mean, atol=4e-4)
        if name == "motor":
            tips = [ROBOT.at(q).point("right_index_tip") for q in trial.joints_rad]
            np.testing.assert_allclose(trial.positions, tips, atol=1e-12)


@pytest.mark.long
def test_a_rendered_trial_is_tracked():
    (movement,) = movements("inner", 1, SEED)
    (trial,) = rendered_trials("inner", 1, SEED)
    errors = np.linalg.norm(trial.positions - movement.trial.positions, axis=1)
    assert np.isfinite(errors[-20:]).mean() > 0.8
    assert np.nanmax(errors[-20:]) < 0.04


@pytest.mark.parametrize("by_eyes", [True, False])
def test_without_errors_the_measurement_is_the_truth(by_eyes):
    (trial,) = exact_trials("motor", 1, SEED)
    for source in (errors_from(), errors_from("cameras")):
        measured = observe(MiscalibratedRobot.draw(source, rng()), trial, by_eyes, rng())
        if not by_eyes or source == errors_from():  # a felt fingertip does not depend on the cameras
            np.testing.assert_allclose(measured.positions, trial.positions, atol=1e-6)
            np.testing.assert_allclose(measured.velocities, trial.velocities, atol=1e-5)
