"""Calibration figure on balls that come straight down on taxels, some of them passing beside."""

import numpy as np
import pytest
from data import SEED

from learning.pps.touch_trial import TouchTrial
from pps_vision.experiments.pps import calibration
from pps_vision.experiments.pps.calibration import WAYS, Calibration, Lived
from pps_vision.experiments.pps.held_out import at_horizon, displaced, of_part
from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.skin import icub_skin, touched_taxels

ROBOT, SKIN = load_icub(), icub_skin()
POSITIONS, NORMALS = SKIN.at(ROBOT.at(home(ROBOT)))


def straight(taxel: int, aside_m: float, rng: np.random.Generator) -> TouchTrial:
    """A ball comes along a taxel's normal to a point beside it."""
    left_s = np.arange(30, -1, -1) * 0.05
    across = np.cross(NORMALS[taxel], rng.standard_normal(3))
    end = POSITIONS[taxel] + 0.03 * NORMALS[taxel] + aside_m * across / np.linalg.norm(across)
    velocity = -rng.uniform(0.06, 0.14) * NORMALS[taxel]
    path = end - left_s[:, None] * velocity
    return TouchTrial(
        1.5 - left_s,
        np.tile(home(ROBOT), (31, 1)),
        path,
        np.tile(velocity, (31, 1)),
        np.zeros((31, 3, 3)),
        np.full(31, 0.03),
        touched_taxels(POSITIONS, end, 0.03),
        SKIN.taxel_ids[taxel],
    )


@pytest.fixture(scope="module")
def trials() -> tuple[tuple[TouchTrial, ...], tuple[TouchTrial, ...]]:
    rng = np.random.default_rng(SEED)
    made = [straight(k % 8, rng.uniform(0, 0.03), rng) for k in range(32)]
    return tuple(made[::2]), tuple(made[1::2])


def test_what_a_fine_map_says_of_exact_tracks_comes_true(
    trials: tuple[tuple[TouchTrial, ...], tuple[TouchTrial, ...]],
) -> None:
    ways = calibration.scores(*(Lived.of(some) for some in trials))
    assert set(ways) == set(WAYS)
    fine = ways["finer, to the surface, corrected"]
    assert fine["auroc"] > ways["rate of touch"]["auroc"]
    assert fine["brier"] < ways["rate of touch"]["brier"]
    assert all(sum(of["n"]) == 16 * 12 for of in ways.values())
    assert Calibration().chart({"ways": ways}).axes


def test_displacements_are_those_of_the_taxels_frames(
    trials: tuple[tuple[TouchTrial, ...], tuple[TouchTrial, ...]],
) -> None:
    skin = of_part(SKIN, "left_forearm")
    for trial, moved in zip(trials[0][:3], displaced(trials[0][:3], ROBOT, skin, SKIN), strict=True):
        apart = trial.positions[:, None] - POSITIONS[:12]
        np.testing.assert_allclose(np.linalg.norm(moved.d_m, axis=2), np.linalg.norm(apart, axis=2))
        np.testing.assert_allclose(moved.d_m[..., 2], np.einsum("tni,ni->tn", apart, NORMALS[:12]), atol=1e-9)
        np.testing.assert_array_equal(moved.touched, trial.touched[:12])


def test_a_prediction_uses_nothing_later_than_its_horizon(
    trials: tuple[tuple[TouchTrial, ...], tuple[TouchTrial, ...]],
) -> None:
    seen = Lived.of(trials[0][:2]).center
    D, _, _ = at_horizon(seen, 0.15)
    np.testing.assert_array_equal(D[0], seen[0].distance_m[-4])
