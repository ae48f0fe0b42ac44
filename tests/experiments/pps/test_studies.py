"""Short runs of the studies of peripersonal space: parts without rendering are measured, drawn and tabulated."""

import json
from pathlib import Path

import pytest
from data import SEED

from pps_vision.experiments.pps_taxel import SIMULATIONS, simulated_ridge
from pps_vision.experiments.study import catalogue
from pps_vision.experiments.tables import read_numbers
from pps_vision.recordings.atomic_write import plain

RESULTS = Path(__file__).parents[3] / "docs" / "results"
PARTS = {
    "pps_taxel": ("monte_carlo", "single_touch"),
    "pps_sessions": ("double_touches", "misaimed", "offsets"),
    "pps_errors": ("compensation",),
}


@pytest.mark.parametrize("name", PARTS)
def test_a_short_run_has_the_form_of_the_published_results(name: str) -> None:
    study = catalogue()[name]
    numbers = json.loads(json.dumps(plain(study(**{**study.short(), "seed": SEED, "parts": PARTS[name]}).run())))
    published = read_numbers(RESULTS / f"{name}.json")
    for part, values in numbers.items():
        assert set(values) <= set(published[part])
    for results in (numbers, published):
        assert all(figure.axes for figure in study().chart(results).values())
        for table in study().tables(results).values():
            assert all(len(row) == len(table.header) for row in table.rows)


def test_the_offset_shows_from_the_landing_point_only() -> None:
    exact, noisy, shifted = (simulated_ridge(simulation, "landing", 5, SEED) for simulation in SIMULATIONS.values())
    assert 0 <= exact["crosses_ttc_0_at_cm"][0] < 4
    assert -11.5 < shifted["crosses_ttc_0_at_cm"][0] < -8.5
    assert exact["ridge_width_cm"] < noisy["ridge_width_cm"] < shifted["ridge_width_cm"]
    assert simulated_ridge(SIMULATIONS["noisy, offset −10 cm"], "taxel", 5, SEED)["crosses_ttc_0_at_cm"][0] > 0
