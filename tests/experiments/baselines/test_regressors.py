"""General regressors as forward models of the arm, in one batch and in many."""

from dataclasses import replace

import numpy as np
import pytest

from learning.reach.babbling import babble
from pps_vision.experiments.baselines.lwpr import LWPR, LWPRParams
from pps_vision.experiments.baselines.regressors import ArmToGaze, gaussian_process, quintic_spline
from pps_vision.experiments.reach_truth import gaze_rmse_deg
from pps_vision.robot.icub import load_icub

BABBLED = babble(load_icub(), "right", 6000, np.random.default_rng(1))
N_TRAIN = 1200


@pytest.mark.parametrize(
    ("make", "max_deg"),
    [
        # J's came to 0.84° with 4400 samples
        pytest.param(lambda: LWPR(4, 3, LWPRParams(init_D=10, w_gen=0.2)), 3.0, marks=pytest.mark.long),
        pytest.param(gaussian_process, 0.1, marks=pytest.mark.long),
        (quintic_spline, 0.15),
    ],
)
def test_the_forward_model_is_learned_whatever_the_batches(make, max_deg):
    test = replace(BABBLED, arm_rad=BABBLED.arm_rad[N_TRAIN:], gaze_rad=BABBLED.gaze_rad[N_TRAIN:])
    whole = ArmToGaze(make())
    batches = ArmToGaze(make())
    whole.learn(BABBLED.arm_rad[:N_TRAIN], BABBLED.gaze_rad[:N_TRAIN])
    for k in range(0, N_TRAIN, N_TRAIN // 3):
        batches.learn(BABBLED.arm_rad[k : k + N_TRAIN // 3], BABBLED.gaze_rad[k : k + N_TRAIN // 3])
    assert gaze_rmse_deg(whole, test)[0] < max_deg
    np.testing.assert_allclose(batches(test.arm_rad), whole(test.arm_rad), atol=1e-6)
