"""Carried into another posture, an approach is the same to the skin; and what the figure says of scores."""

import numpy as np
from data import SEED

from learning.pps.receptive_field import ReceptiveField
from learning.pps.touch_trial import TouchTrial, perceived
from pps_vision.experiments.pps import invariance
from pps_vision.experiments.pps.invariance import Invariance, carried
from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.skin import icub_skin

ROBOT, SKIN = load_icub(), icub_skin(("left_forearm",))


def an_approach() -> TouchTrial:
    q = home(ROBOT)
    positions, normals = SKIN.at(ROBOT.at(q))
    left_s = 0.05 * np.arange(20, -1, -1)
    path = positions[2] + (0.03 + 0.1 * left_s[:, None]) * normals[2]
    velocities = np.tile(-0.1 * normals[2], (21, 1))
    certain = np.tile(1e-6 * np.diag([1.0, 2.0, 3.0]), (21, 1, 1)), np.full(21, 0.03)
    return TouchTrial(1 - left_s, np.tile(q, (21, 1)), path, velocities, *certain, np.ones(12, bool), SKIN.taxel_ids[2])


def test_in_another_posture_the_skin_perceives_the_same() -> None:
    rng, trial = np.random.default_rng(SEED), an_approach()
    before = perceived(trial, ROBOT, SKIN, ReceptiveField())
    for _ in range(5):
        moved = carried(trial, ROBOT, rng)
        assert np.abs(moved.joints_rad - trial.joints_rad).max() > np.deg2rad(5)
        assert np.all((moved.joints_rad >= ROBOT.lower_rad) & (moved.joints_rad <= ROBOT.upper_rad))
        assert np.linalg.norm(moved.positions[-1] - trial.positions[-1]) > 0.005
        for one, other in zip(before, perceived(moved, ROBOT, SKIN, ReceptiveField()), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-6)


def test_what_was_found_is_drawn() -> None:
    one = {"auroc": 0.9, "brier": 0.1}
    modalities = {a: dict.fromkeys(invariance._MODALITIES, one) for a in invariance._MODALITIES}
    figure = Invariance().chart({"postures": {"no errors: learned home, tested home": one}, "modalities": modalities})
    assert len(figure.axes) == 3
