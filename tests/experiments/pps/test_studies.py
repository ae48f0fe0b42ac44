"""Short runs of the studies of peripersonal space: parts without rendering are measured, drawn and tabulated."""

import pytest
from data import SEED
from documents import ROOT
from drawn_study import run_and_draw

from pps_vision.experiments.pps_taxel import SIMULATIONS, simulated_ridge
from pps_vision.experiments.study import catalogue
from pps_vision.experiments.tables import read_numbers

PARTS = {
    "pps_taxel": ("monte_carlo", "single_touch"),
    "pps_sessions": ("offsets",),
    "pps_prediction": ("compensation",),
}


@pytest.mark.parametrize("name", PARTS)
def test_a_short_run_has_the_form_of_the_published_results(name):
    study = catalogue()[name]
    numbers, _ = run_and_draw(study(**{**study.short(), "seed": SEED, "parts": PARTS[name]}))
    published = read_numbers(ROOT / "docs" / "results" / f"{name}.json")
    for part, values in numbers.items():
        assert set(values) <= set(published[part])


def test_the_offset_shows_from_the_landing_point_only():
    exact, noisy, shifted = (simulated_ridge(simulation, "landing", 5, SEED) for simulation in SIMULATIONS.values())
    assert 0 <= exact["crosses_ttc_0_at_cm"][0] < 4
    assert -11.5 < shifted["crosses_ttc_0_at_cm"][0] < -8.5
    assert exact["ridge_width_cm"] < noisy["ridge_width_cm"] < shifted["ridge_width_cm"]
    assert simulated_ridge(SIMULATIONS["noisy, offset −10 cm"], "taxel", 5, SEED)["crosses_ttc_0_at_cm"][0] > 0
