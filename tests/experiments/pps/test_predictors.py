"""Predictors of touch on balls that approach taxels along their normals, some passing beside."""

import numpy as np
import pytest
from data import SEED

from learning.pps.touch_trial import TouchTrial
from learning.pps.trials import Trial
from pps_vision.experiments.pps import calibration
from pps_vision.experiments.pps.perceived import FOREARM, PerceivedTrial, at_horizon, displacements
from pps_vision.experiments.pps.predictors import METHODS, Inputs, by_fine_map, corrected, landing_gap
from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.skin import icub_skin, touched_taxels
from pps_vision.types import Array

ROBOT, SKIN = load_icub(), icub_skin()
POSITIONS, NORMALS = SKIN.at(ROBOT.at(home(ROBOT)))
Trials = tuple[TouchTrial, ...]


def straight(taxel: int, aside_m: float, rng: np.random.Generator) -> TouchTrial:
    """A ball approaches along a taxel's normal, displaced to one side."""
    left_s = np.arange(30, -1, -1) * 0.05
    across = np.cross(NORMALS[taxel], rng.standard_normal(3))
    end = POSITIONS[taxel] + 0.03 * NORMALS[taxel] + aside_m * across / np.linalg.norm(across)
    velocity = -rng.uniform(0.06, 0.14) * NORMALS[taxel]
    path = end - left_s[:, None] * velocity
    certain = np.zeros((31, 3, 3)), np.full(31, 0.03)
    touched = touched_taxels(POSITIONS, end, 0.03)
    joints = np.tile(home(ROBOT), (31, 1))
    return TouchTrial(1.5 - left_s, joints, path, np.tile(velocity, (31, 1)), *certain, touched, SKIN.taxel_ids[taxel])


@pytest.fixture(scope="module")
def trials() -> tuple[Trials, Trials]:
    rng = np.random.default_rng(SEED)
    made = [straight(k % 8, rng.uniform(0, 0.03), rng) for k in range(32)]
    return tuple(made[::2]), tuple(made[1::2])


def test_every_predictor_returns_probabilities_and_the_combination_beats_the_base_rate(
    trials: tuple[Trials, Trials],
) -> None:
    training, test = (Inputs.of(some) for some in trials)
    for predictor in METHODS.values():
        p = predictor(training, test)
        assert p.shape == (16, 12)
        assert np.all((p >= 0) & (p <= 1))
    found = calibration.evaluate(training, test)
    ours, base = found["fine map, displacement, landing, corrected"], found["base rate"]
    assert ours["auroc"] > base["auroc"]
    assert ours["brier"] < base["brier"]


def test_a_prediction_uses_nothing_later_than_its_horizon(trials: tuple[Trials, Trials]) -> None:
    """The last two samples of the test trials may be anything."""
    training = Inputs.of(trials[0])
    changed = [TouchTrial(*(getattr(t, name) for name in t.__slots__)) for t in trials[1]]
    for k, t in enumerate(changed):
        path = t.positions.copy()
        path[-2:] += 0.05
        changed[k] = TouchTrial(*(path if name == "positions" else getattr(t, name) for name in t.__slots__))
    for predictor in METHODS.values():
        np.testing.assert_allclose(
            predictor(training, Inputs.of(trials[1])), predictor(training, Inputs.of(tuple(changed)))
        )


def test_the_fine_map_weighs_other_taxels_a_fifth_and_empty_bins_not_at_all() -> None:
    """One trial touches the first of two taxels that perceive the same samples: 1 : 0.2 and 0.2 : 1."""
    left_s, same = np.array([0.5, 0.15]), np.full((2, 2), 0.5)
    trial = PerceivedTrial(left_s, 0.1 * same, same, np.array([True, False]))
    inputs = Inputs((trial,), (trial,), (), np.zeros((1, 2)))
    np.testing.assert_allclose(by_fine_map(inputs, inputs), [[1 / 1.2, 0.2 / 1.2]])


def test_the_correction_is_fitted_on_trials_left_out(trials: tuple[Trials, Trials]) -> None:
    training, test = (Inputs.of(some) for some in trials)
    overlaps = []

    def predictor(seen: Inputs, asked: Inputs) -> Array:
        overlaps.append(set(map(id, seen.center)) & set(map(id, asked.center)))
        return np.full(asked.touched.shape, 0.5)

    p = corrected(predictor)(training, test)
    assert len(overlaps) == 9  # eight folds and the test trials
    assert not any(overlaps)
    np.testing.assert_allclose(p, training.touched.mean())


def test_displacements_are_in_the_taxels_frames(trials: tuple[Trials, Trials]) -> None:
    for trial, moved in zip(trials[0][:3], displacements(trials[0][:3], ROBOT, SKIN), strict=True):
        apart = trial.positions[:, None] - POSITIONS[:12]
        np.testing.assert_allclose(np.linalg.norm(moved.d_m, axis=2), np.linalg.norm(apart, axis=2))
        np.testing.assert_allclose(moved.d_m[..., 2], np.einsum("tni,ni->tn", apart, NORMALS[:12]), atol=1e-9)
        np.testing.assert_array_equal(moved.touched, trial.touched[:12])
    assert SKIN.taxel_ids[11].startswith(FOREARM)


def test_the_horizon_is_0_15_s_before_the_end(trials: tuple[Trials, Trials]) -> None:
    seen = Inputs.of(trials[0][:2]).center
    D, _, _ = at_horizon(seen)
    np.testing.assert_array_equal(D[0], seen[0].distance_m[-4])


def test_reliability_counts_every_prediction_once() -> None:
    touched = np.array([True, False, True, True])
    found = calibration.scores(touched, np.array([0.05, 0.05, 0.95, 1.0]))["touched_percent"]
    assert found[0][0] == 50
    assert found[9][0] == 100
    assert all(tenth is None for tenth in found[1:9])
    assert found[9][1] == pytest.approx(100 * 2 / (2 + 1.96**2), abs=0.1)  # Wilson: n / (n + z²)


def test_a_straight_path_lands_where_geometry_says():
    """Down the first taxel's normal at 0.1 m/s; a second taxel lies 4 cm beside.  Later samples have no influence."""
    t = np.arange(0, 1.01, 0.05)
    path = np.column_stack([np.zeros_like(t), np.zeros_like(t), 0.03 + 0.1 * (1.0 - t)])
    path[t > 0.81] = np.nan
    d = np.stack([path, path + np.array([0.04, 0.0, 0.0])], axis=1)
    trial = Trial(t, d, np.zeros_like(d), np.array([True, False]))
    np.testing.assert_allclose(landing_gap(trial, 0.03, 0.2), [0.0, 0.02], atol=1.1e-3)
    assert np.isinf(landing_gap(trial, 0.03, 2.0)).all()
