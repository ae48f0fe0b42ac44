"""One positive trial is enough to expect the next one in time (the issue's number)."""

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments.pps.one_trial import APPROACHES, LEAD_S, MAPS, THRESHOLD, OneTrial, met_again


@pytest.mark.parametrize("approach", APPROACHES)
def test_the_next_identical_approach_is_expected_0_3_s_ahead(approach):
    before_s, expected = met_again(
        APPROACHES[approach], MAPS["8×4, σ 1 bin (R, default)"], 100, np.random.default_rng(SEED)
    )
    assert expected.shape == (61, 100)
    in_time = before_s >= LEAD_S - 1e-9
    assert (expected[in_time].max(axis=0) > THRESHOLD).all()


def test_half_the_window_stays_above_at_0_3_s():
    shower = APPROACHES["5 cm/s"]
    before_s, expected = met_again(shower, MAPS["8×4, σ 0.5 bin"], 100, np.random.default_rng(SEED))
    assert np.mean(expected[int(np.argmin(np.abs(before_s - LEAD_S)))] > THRESHOLD) >= 0.98


def test_the_chart_is_drawn_from_the_numbers():
    experiment = OneTrial(SEED, trials=5)
    assert len(experiment.chart(experiment.run()).axes) == len(APPROACHES)
