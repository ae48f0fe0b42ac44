"""Alarms and lead times of a memory that is certain within 10 cm, counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from learning.pps.memory import MemoryParams, PPSMemory
from learning.pps.receptive_field import ReceptiveField
from learning.pps.touch_trial import TouchTrial, perceived
from pps_vision.experiments.pps import without_ttc
from pps_vision.experiments.pps.held_out import Approach
from pps_vision.experiments.pps.without_ttc import MODELS
from pps_vision.robot.icub import home, load_icub
from pps_vision.robot.skin import icub_skin


@pytest.fixture
def memory() -> PPSMemory:
    """One taxel, sure of a touch below 10 cm, of none above; bins of 1 cm, hardly smoothed."""
    params = MemoryParams((0.0, 0.2), (0.0, 3.0), (20, 1), 0.01)
    counts = np.zeros((1, 20, 1, 2), np.int64)
    counts[0, :10, 0, 0] = counts[0, 10:, 0, 1] = 1
    return PPSMemory(("a",), np.zeros(1, np.intp), counts, params)


def approach(distance_m: list[float]) -> Approach:
    T = len(distance_m)
    return Approach(0.05 * np.arange(T)[::-1], np.array(distance_m)[:, None], np.ones((T, 1)), np.array([True]))


def test_an_alarm_takes_as_long_as_the_arm_asks_for(memory: PPSMemory) -> None:
    found = without_ttc._alarm(memory, approach([0.15, 0.095, 0.085, 0.075, 0.065, 0.055]))
    np.testing.assert_array_equal(found, [False, False, False, False, True, True])
    assert not without_ttc._alarm(memory, approach([0.095, 0.085, 0.075, 0.155, 0.095, 0.085])).any()


def test_the_lead_is_counted_back_from_the_touch_to_the_last_doubt(memory: PPSMemory) -> None:
    assert without_ttc._lead_s(memory, approach([0.095, 0.155, 0.085, 0.065, 0.045]))[0] == pytest.approx(0.1)
    assert without_ttc._lead_s(memory, approach([0.095, 0.155]))[0] == 0
    assert without_ttc._lead_s(memory, approach([0.095, 0.085]))[0] == pytest.approx(0.05)


def test_what_stands_or_withdraws_has_no_time_to_contact() -> None:
    robot, skin = load_icub(), icub_skin(("left_forearm",))
    q = home(robot)
    positions, normals = skin.at(robot.at(q))
    path = positions[1] + np.linspace(0.15, 0.05, 20)[:, None] * normals[1]
    velocity = np.gradient(path, 0.05, axis=0)
    still = np.zeros((20, 3, 3)), np.full(20, 0.03)
    touched = np.zeros(12, bool)
    trial = TouchTrial(0.05 * np.arange(20), np.tile(q, (20, 1)), path, velocity, *still, touched, skin.taxel_ids[1])
    coming = perceived(trial, robot, skin, ReceptiveField())[1][:, 1]
    going = perceived(without_ttc._reversed(trial), robot, skin, ReceptiveField())[1][:, 1]
    standing = perceived(without_ttc._stopped(trial), robot, skin, ReceptiveField())[1][:, 1]
    assert np.all(coming > 0)
    np.testing.assert_allclose(going, -coming[::-1], rtol=1e-6)
    assert np.all(np.abs(standing) > 1e6)


def test_without_ttc_what_withdraws_is_as_near_as_what_comes() -> None:
    params = MODELS["distance only"]
    assert params.covers(np.array([0.1]), np.array([-1.0])).all()
    assert params.covers(np.array([0.1]), np.array([np.inf])).all()
    assert not replace(params, ttc_range_s=(0.0, 3.0)).covers(np.array([0.1]), np.array([-1.0])).any()
