"""The representations figure: what is chosen, and that what is said is corrected on trials left out."""

import numpy as np
import pytest
from data import SEED

from learning.memory import MemoryParams
from learning.representations import Counts
from learning.scores import expected_calibration_error
from pps_vision.experiments.pps import representations
from pps_vision.experiments.pps.held_out import Approach, at_horizon

TABLE = {
    "quick": {"ece": 0.08, "brier": 0.2, "auroc": 0.7, "time": {"median_ms": 0.1}},
    "slow": {"ece": 0.01, "brier": 0.1, "auroc": 0.9, "time": {"median_ms": 1.0}},
}


@pytest.mark.parametrize(("max_ece", "chosen"), [(0.1, "quick"), (0.05, "slow"), (0.001, None)])
def test_the_choice_is_made_by_the_table_and_told_by_other_trials(max_ece: float, chosen: str | None) -> None:
    others = {"quick": {"ece": 0.3, "brier": 0.4}, "slow": {"ece": 0.02, "brier": 0.12}}
    found = representations._choice(TABLE, others, max_ece, 1.0)
    assert found["chosen"] == chosen
    if chosen is not None:
        assert found["ece_on_others"] == others[chosen]["ece"]


def coming(n: int, rng: np.random.Generator) -> tuple[Approach, ...]:
    """Objects at 10 cm/s that touch the less likely the farther they still are 0.2 s before the end."""
    left_s = 0.05 * np.arange(20, -1, -1)
    end = rng.uniform(0, 0.1, n)
    touched = rng.uniform(size=n) < 1 - end / 0.1
    made = ((0.1 * left_s + e)[:, None] for e in end)
    return tuple(Approach(left_s, D, D / 0.1, np.array([y])) for D, y in zip(made, touched, strict=True))


def test_corrected_predictions_come_true() -> None:
    rng = np.random.default_rng(SEED)
    lessons, tests = coming(400, rng), coming(2000, rng)
    foresee = representations._corrected(Counts(MemoryParams()), lessons, rng)
    D, TTC, touched = at_horizon(tests)
    assert expected_calibration_error(touched, foresee(D, TTC)) < 0.07
