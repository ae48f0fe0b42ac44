"""Predictors of touch on balls that approach taxels along their normals, some passing beside."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED

from learning.pps.receptive_field import ReceptiveField
from learning.pps.receptive_field import perceive as perceive_at
from learning.pps.trials import TouchTrial
from pps_vision.experiments.pps import calibration, real_trials
from pps_vision.experiments.pps.calibration import METHODS
from pps_vision.experiments.pps.perceived import HORIZON_S, at_horizon, in_taxel_frames, perceive
from pps_vision.experiments.pps.predictors import (
    Trials,
    by_base_rate,
    by_fine_map,
    by_map,
    by_shrunk_map,
    by_trees,
    by_trees_of_distance_and_ttc,
    corrected,
    landing_gap,
    outcomes,
)
from pps_vision.experiments.pps.scores import brier
from pps_vision.experiments.pps.taxel_trials import Trial
from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.skin import icub_skin, touched_taxels
from pps_vision.types import Array

ROBOT, SKIN = load_icub(), icub_skin()
POSITIONS, NORMALS = SKIN.at(ROBOT.at(home(ROBOT)))


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
    return TouchTrial(1.5 - left_s, joints, path, np.tile(velocity, (31, 1)), *certain, touched)


@pytest.fixture(scope="module")
def trials() -> tuple[Trials, Trials]:
    rng = np.random.default_rng(SEED)
    made = in_taxel_frames([straight(k % 8, rng.uniform(0, 0.03), rng) for k in range(32)])
    return made[::2], made[1::2]


@pytest.mark.filterwarnings("error")
def test_trees_are_fitted_where_objects_stand_still(trials: tuple[Trials, Trials]) -> None:
    """TTC is infinite there, and between infinities no quantile can be interpolated."""
    still = [replace(trial, v_m_s=0 * trial.v_m_s) for trial in trials[0]]
    jitter = np.random.default_rng(SEED)
    training = [
        replace(one, d_m=one.d_m + jitter.normal(0, 0.002, 3)) for _ in range(6) for one in (*trials[0], *still)
    ]
    D, TTC = at_horizon(training)
    assert len(np.unique(D[np.isfinite(D)])) > 255  # with as few as the bins there are no quantiles
    assert np.isinf(TTC).any()
    for predictor in (by_trees, by_trees_of_distance_and_ttc):
        p = predictor(training, trials[1], HORIZON_S)
        assert np.all((p >= 0) & (p <= 1))


def test_every_predictor_returns_probabilities_and_the_fine_map_beats_the_base_rate(
    trials: tuple[Trials, Trials],
) -> None:
    for predictor in METHODS.values():
        p = predictor(*trials, HORIZON_S)
        assert p.shape == (16, 12)
        assert np.all((p >= 0) & (p <= 1))
    found = calibration.evaluate(*trials)
    ours, base = found["fine map, corrected"]["scores"], found["base rate"]["scores"]
    assert ours["auroc"][0] > base["auroc"][0]
    assert ours["brier"][0] < base["brier"][0]
    for low, high in (one["auroc"][1:] for one in (ours, base)):
        assert 0 <= low < high <= 1


def test_a_prediction_uses_nothing_later_than_its_horizon(trials: tuple[Trials, Trials]) -> None:
    """The last two samples of the test trials may be anything."""
    training, test = trials
    changed = [replace(trial, d_m=trial.d_m.copy(), v_m_s=trial.v_m_s.copy()) for trial in test]
    for trial in changed:
        trial.d_m[-2:], trial.v_m_s[-2:] = 0.05, -1.0
    for predictor in {**METHODS, **real_trials.METHODS}.values():
        np.testing.assert_allclose(predictor(training, test, HORIZON_S), predictor(training, changed, HORIZON_S))


def test_the_radius_is_the_median_known_at_the_horizon() -> None:
    trial = straight(0, 0.0, np.random.default_rng(SEED))
    radius = np.linspace(0.01, 0.04, 31)
    radius[0] = np.nan
    (seen,) = in_taxel_frames([replace(trial, radius_m=radius)])
    assert seen.radius_m == pytest.approx(np.median(radius[1:28]))
    (unknown,) = in_taxel_frames([replace(trial, radius_m=np.full(31, np.nan))])
    assert unknown.radius_m == 0


def test_the_fine_map_weighs_other_taxels_a_fifth_and_empty_bins_not_at_all() -> None:
    """One trial touches the first of two taxels that perceive the same samples: 1 : 0.2 and 0.2 : 1."""
    d, v = np.tile([0.0, 0.0, 0.1], (2, 2, 1)), np.tile([0.0, 0.0, -0.1], (2, 2, 1))
    trial = Trial(np.array([0.0, 0.35]), d, v, np.array([True, False]))
    np.testing.assert_allclose(by_fine_map([trial], [trial], HORIZON_S), [[1 / 1.2, 0.2 / 1.2]])


def test_the_correction_is_fitted_on_trials_left_out(trials: tuple[Trials, Trials]) -> None:
    overlaps = []

    def predictor(seen: Trials, asked: Trials, horizon_s: float) -> Array:
        overlaps.append(set(map(id, seen)) & set(map(id, asked)))
        return np.full((len(asked), 12), 0.5)

    p = corrected(predictor)(*trials, HORIZON_S)
    assert len(overlaps) == 9  # eight folds and the test trials
    assert not any(overlaps)
    np.testing.assert_allclose(p, outcomes(trials[0]).mean())


def test_in_taxel_frames_the_skin_at_rest_perceives_each_frame_alone() -> None:
    rng = np.random.default_rng(SEED)
    still = straight(3, 0.01, rng)
    covs = np.tile(np.diag([0.03, 0.02, 0.01]) ** 2, (31, 1, 1))
    true = replace(still, velocities=0.1 * rng.standard_normal((31, 3)), velocity_covs=covs)
    (seen,) = in_taxel_frames([true])
    apart = true.positions[:, None] - POSITIONS[:12]
    np.testing.assert_allclose(seen.d_m[..., 2], np.einsum("tni,ni->tn", apart, NORMALS[:12]), atol=1e-9)
    np.testing.assert_array_equal(seen.touched, true.touched[:12])
    field = ReceptiveField(distance_to="surface")
    skin = POSITIONS[:12], NORMALS[:12]
    alone = perceive_at(field, *skin, true.positions, true.velocities, 0.03, true.velocity_covs)
    np.testing.assert_allclose(perceive(seen, field), alone, rtol=1e-6)


def bending() -> Array:
    """A left elbow that bends at 20°/s, 21 samples."""
    joints = np.tile(home(ROBOT), (21, 1))
    joints[:, ROBOT.indices(("left_elbow",))[0]] += np.deg2rad(20) * 0.05 * np.arange(21)
    return joints


def test_to_a_moving_arm_what_stands_still_comes_as_fast_as_it_nears() -> None:
    joints, none = bending(), np.zeros((21, 3))
    taxels = np.array([SKIN.at(ROBOT.at(q))[0] for q in joints])[:, :12]
    p = np.tile(taxels[10, 0] + np.array([-0.05, 0.02, 0.06]), (21, 1))
    of_ball = TouchTrial(0.05 * np.arange(21), joints, p, none, np.zeros((21, 3, 3)), np.zeros(21), np.zeros(32, bool))
    D, ttc = perceive(in_taxel_frames([of_ball])[0])
    gap = np.linalg.norm(taxels - p[:, None], axis=2)
    closing = -np.gradient(gap, 0.05, axis=0)
    inside = np.isfinite(D) & (np.abs(closing) > 0.01)
    inside[[0, -1]] = False
    assert inside.sum() > 50
    np.testing.assert_allclose(ttc[inside], gap[inside] / closing[inside], rtol=0.02)


def test_the_horizon_is_0_15_s_before_the_end(trials: tuple[Trials, Trials]) -> None:
    D, TTC = at_horizon(trials[0][:2])
    np.testing.assert_array_equal(D[0], perceive(trials[0][0])[0][-4])
    np.testing.assert_array_equal(TTC[1], perceive(trials[0][1])[1][-4])
    assert np.isnan(at_horizon(trials[0][:2], 2.0)).all()


def test_reliability_counts_every_prediction_once() -> None:
    touched = np.array([True, False, True, True])
    found = calibration.shares(touched, np.array([0.05, 0.05, 0.95, 1.0]))
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
    trial = Trial(t, d, np.zeros_like(d), np.array([True, False]), 0.03)
    np.testing.assert_allclose(landing_gap(trial, 0.2), [0.0, 0.02], atol=1.1e-3)
    assert np.isinf(landing_gap(trial, 2.0)).all()


def test_trees_and_shrunk_maps_find_what_touches_and_invent_nothing(trials: tuple[Trials, Trials]) -> None:
    """Better than the base rate on balls that pass or touch; on outcomes dealt to other balls no prior is too large."""
    training, test = trials
    touched = outcomes(test)
    rate = brier(touched, by_base_rate(training, test, HORIZON_S))
    assert brier(touched, by_trees(training, test, HORIZON_S)) < rate
    assert brier(touched, by_shrunk_map(training, test, HORIZON_S)) < rate
    dealt = [replace(trial, touched=other.touched) for trial, other in zip(training, training[::-1], strict=True)]
    p, base = (predict(dealt, test, HORIZON_S) for predict in (by_shrunk_map, by_base_rate))
    assert np.abs(p - base).max() < np.abs(by_map(dealt, test, HORIZON_S) - base).max()
