"""Random search: what is drawn, and what a draw is judged by."""

import numpy as np
import pytest

from pps_vision.app.encounters.registry import BASELINES
from pps_vision.experiments.encounters_tuning import draw_numbers, score


def test_parameters_are_drawn_from_their_ranges_the_gain_evenly_in_its_logarithm() -> None:
    baseline, rng = BASELINES["potential field"], np.random.default_rng(1)
    drawn = [draw_numbers(baseline, rng) for _ in range(400)]
    for name, (low, high) in baseline.ranges.items():
        values = np.array([one[name] for one in drawn])
        if name == "gain":
            values, low, high = np.log(values), np.log(low), np.log(high)
        assert low <= values.min() < low + 0.02 * (high - low)
        assert high - 0.02 * (high - low) < values.max() <= high
        assert values.mean() == pytest.approx((low + high) / 2, abs=0.05 * (high - low))


def test_the_score_adds_what_touches_and_what_moves_the_arm_without_cause() -> None:
    rows = [{"condition": "press", "touched": k < 1, "commands": 5} for k in range(4)]
    rows += [{"condition": "harmless_static", "touched": False, "commands": commands} for commands in (0, 0, 0, 0, 1)]
    assert score(rows) == 25 + 20
