"""Studies on simulated single taxels: Monte Carlo, single touch, failures, whole skin."""

import numpy as np
import pytest
from data import SEED
from drawn_study import run_and_draw

from learning.pps.memory import MemoryParams
from pps_vision.experiments.pps import failures, whole_skin
from pps_vision.experiments.pps.failures import DISTURBANCES, MAPS, PpsFailures, record
from pps_vision.experiments.pps.monte_carlo import SIMULATIONS, MonteCarlo
from pps_vision.experiments.pps.single_touch import APPROACHES, LEAD_S, THRESHOLD, SingleTouch, repeat_approaches
from pps_vision.experiments.pps.whole_skin import WholeSkin, activations, buffer_at_touch, make_body
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
def test_after_one_touch_the_threshold_is_passed_0_3_s_before_the_next(approach: str) -> None:
    before_s, found = repeat_approaches(APPROACHES[approach], MemoryParams(), 100, np.random.default_rng(SEED))
    assert found.shape == (61, 100)
    assert (found[before_s >= LEAD_S - 1e-9].max(axis=0) > THRESHOLD).all()


def test_half_the_window_stays_above_the_threshold_0_3_s_before() -> None:
    params = MemoryParams(sigma_bins=0.5)
    before_s, found = repeat_approaches(APPROACHES["5 cm/s"], params, 100, np.random.default_rng(SEED))
    assert np.mean(found[int(np.argmin(np.abs(before_s - LEAD_S)))] > THRESHOLD) >= 0.98


def test_the_single_touch_is_drawn() -> None:
    numbers, _ = run_and_draw(SingleTouch(SEED, n=20))
    assert set(numbers["approaches"]) == set(APPROACHES)
    for maps in numbers["approaches"].values():
        found = maps["8×4, σ 1 bin (R, default)"]
        assert found["passed_at_lead_percent"] == 100
        assert found["activation"][-1][0] < found["activation"][-4][0]  # it falls in the last 0.1 s


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


def test_the_cost_of_the_skin_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_skin, "TAXELS", (32, 500))
    numbers, _ = run_and_draw(WholeSkin(SEED, n=5))
    assert all(len(rows) == 2 and rows[0][0] > 0 for rows in numbers["ms"].values())
