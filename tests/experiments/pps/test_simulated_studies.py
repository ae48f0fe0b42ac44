"""Studies on simulated single taxels: Monte Carlo, single touch, failures, whole skin."""

import numpy as np
import pytest
from data import SEED
from drawn_study import run_and_draw

from learning.pps.memory import MemoryParams
from pps_vision.experiments.pps import failures, whole_skin
from pps_vision.experiments.pps.failures import DISTURBANCES, MAPS, PpsFailures, record
from pps_vision.experiments.pps.monte_carlo import SIMULATIONS, MonteCarlo
from pps_vision.experiments.pps.single_touch import (
    APPROACHES,
    FIELDS,
    LEAD_S,
    THRESHOLD,
    SingleTouch,
    repeat_approaches,
)
from pps_vision.experiments.pps.whole_skin import (
    WholeSkin,
    activations,
    activations_by_arrays,
    buffer_at_touch,
    make_body,
)
from pps_vision.experiments.study import Axis


def test_the_offset_shows_from_the_landing_point_and_noise_widens_the_ridge() -> None:
    study = MonteCarlo(SEED, n=5)
    exact, noisy, off = (study.measure(simulation, "landing") for simulation in SIMULATIONS.values())
    assert 0 <= exact["crosses_ttc_0_at_cm"][0] < 4  # the mean line of all speeds passes a little beside 0
    assert -11.5 < off["crosses_ttc_0_at_cm"][0] < -8.5
    assert exact["ridge_width_cm"] < noisy["ridge_width_cm"] < off["ridge_width_cm"]


def test_the_offset_does_not_show_from_the_taxel() -> None:
    off = MonteCarlo(SEED, n=5).measure(SIMULATIONS["noisy, offset −10 cm"], "taxel")
    assert off["crosses_ttc_0_at_cm"][0] > 0


def test_the_monte_carlo_draws_six_maps() -> None:
    _, charts = run_and_draw(MonteCarlo(SEED, n=1))
    assert len([axis for axis in charts[""].axes if axis.images]) == 6


@pytest.mark.parametrize("approach", APPROACHES)
def test_after_one_touch_the_activation_is_high_until_the_next(approach: str) -> None:
    rng = np.random.default_rng(SEED)
    before_s, found = repeat_approaches(APPROACHES[approach], MemoryParams(), FIELDS["surface"], 100, rng)
    assert found.shape == (61, 100)
    lasting = (before_s < LEAD_S + 1e-9) & (before_s > 1e-9)
    assert np.mean(found[lasting] > THRESHOLD) >= 0.99
    if "30" not in approach:  # the last sample may have been 1.5 cm away, in the next bin
        assert np.mean(found[-1] > THRESHOLD) >= 0.99


def test_the_single_touch_is_drawn() -> None:
    numbers, _ = run_and_draw(SingleTouch(SEED, n=20))
    assert set(numbers["approaches"]) == set(APPROACHES)
    for of_reference in numbers["approaches"].values():
        surface, centre = (of_reference[name]["8×4, σ 1 bin (R, default)"]["activation"][-1][0] for name in FIELDS)
        assert surface > centre


def auroc(name: str, severity: float) -> float:
    recording = record(DISTURBANCES[name][1], SEED, severity)
    return float(np.asarray(failures._map(MAPS["8×4 (R, default)"])(recording, 0)["auroc"])[0])


@pytest.mark.parametrize("name", DISTURBANCES)
def test_the_map_predicts_undisturbed_and_the_worst_severity_costs(name: str) -> None:
    severities = DISTURBANCES[name][0].severities
    mild, worst = auroc(name, severities[0]), auroc(name, severities[-1])
    assert mild > 0.87
    assert worst < mild - 0.05


def test_excessive_noise_leaves_chance() -> None:
    assert 0.4 < auroc("track noise", 300) < 0.65


def test_the_failures_are_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    few = (Axis("training trials", (20, 2)), DISTURBANCES["few trials"][1])
    monkeypatch.setattr(failures, "DISTURBANCES", {"few trials": few})
    numbers, _ = run_and_draw(PpsFailures(SEED, n=1))
    assert set(numbers["disturbances"]["few trials"]["methods"]) == set(MAPS)


def test_only_taxels_near_the_ball_are_activated() -> None:
    body = make_body(500, np.random.default_rng(SEED))
    active = activations(body) > 0
    assert 0 < active.sum() < 100
    assert np.isfinite(buffer_at_touch(body).samples[30].distance_m)[active].all()


@pytest.mark.parametrize("sample", [10, 30, 45, 59])
def test_the_compiled_activations_are_those_of_the_equations(sample: int) -> None:
    body = make_body(2000, np.random.default_rng(SEED))
    expected = activations_by_arrays(body, sample)
    assert (expected > 0).any()
    np.testing.assert_allclose(activations(body, sample), expected, rtol=1e-9)


def test_the_cost_of_the_skin_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_skin, "TAXELS", (32, 500))
    numbers, _ = run_and_draw(WholeSkin(SEED, n=5))
    assert all(len(rows) == 2 and rows[0][0] > 0 for rows in numbers["ms"].values())
