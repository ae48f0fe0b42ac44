"""Leaning with a map that is plain geometry: a ball that moves with the torso."""

import numpy as np
import pytest

from control import lean
from control.lean import LeanParams
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.icub import load_icub

ROBOT = load_icub()
PARAMS = LeanParams()
DT = 0.05
AT_ONCE = LeanParams(torso_rad_s=10.0)
MODEL = GazeModel(ROBOT)
LIMITS = GazeLimits()
TORSO = ROBOT.indices(ROBOT.names.torso)
CENTER = np.array([-0.32, 0.08, 0.25])
RADIUS = 0.10  # the reachable space of an upright torso
ASIDE = CENTER + np.array([0.0, 0.18, 0.0])
FAR = CENTER - np.array([0.35, 0.0, 0.0])
START = ROBOT.clamp(np.zeros(ROBOT.n_joints))


def in_ball(gaze):
    finite = np.isfinite(gaze).all(axis=1)
    off = np.full(len(gaze), np.inf)
    off[finite] = np.linalg.norm(MODEL.points(gaze[finite]) - CENTER, axis=1)
    return off < RADIUS


def step(q, point, hold_s=DT, params=PARAMS):
    return lean.step(params, MODEL, LIMITS, in_ball, ROBOT.at(q), point, hold_s, 3.0)


def upright(q, point):
    """Where a point that moves with the torso would lie, by Pinocchio's frames instead of the gaze model's chain."""
    straight = q.copy()
    straight[TORSO] = 0
    T_leaning = ROBOT.at(q).T_root("chest")
    T_upright = ROBOT.at(straight).T_root("chest")
    return (T_upright @ np.linalg.inv(T_leaning) @ np.append(point, 1))[:3]


def test_the_torso_turns_straight_to_the_nearest_posture_that_reaches():
    q = START.copy()
    turned = 0.0
    for _ in range(100):
        status, command = step(q, ASIDE)
        if status == "within reach":
            break
        assert status == "leaning"
        assert np.linalg.norm(command.dq_rad_s[TORSO]) <= np.deg2rad(15) + 1e-12
        assert not np.delete(command.dq_rad_s, TORSO).any()
        q = q + DT * command.dq_rad_s
        turned = turned + DT * np.linalg.norm(command.dq_rad_s)
    assert status == "within reach"
    assert np.linalg.norm(upright(q, ASIDE) - CENTER) < RADIUS
    assert turned == pytest.approx(np.linalg.norm(q[TORSO] - START[TORSO]), rel=0.02)
    smallest = np.inf
    for torso in np.deg2rad(np.stack(np.meshgrid(*[np.arange(-40, 41, 1.0)] * 2), axis=-1).reshape(-1, 2)):
        q_there = START.copy()
        q_there[TORSO] = torso
        if np.linalg.norm(upright(q_there, ASIDE) - CENTER) < RADIUS:
            smallest = min(smallest, float(np.linalg.norm(torso - START[TORSO])))
    assert smallest - np.deg2rad(1.5) <= turned <= smallest + np.deg2rad(4)
    goal = 0.5 * step(START, ASIDE, hold_s=0.5, params=AT_ONCE)[1].dq_rad_s
    assert np.linalg.norm(goal) <= smallest + np.deg2rad(4)


def test_the_last_step_does_not_pass_the_goal():
    """However fast the torso, held to its end the command ends where the object is reachable, within the limits."""
    status, command = step(START, ASIDE, hold_s=0.5, params=AT_ONCE)
    q = START + command.hold_s * command.dq_rad_s
    assert status == "leaning"
    assert step(q, ASIDE)[0] == "within reach"
    np.testing.assert_array_equal(ROBOT.clamp(q), q)


def test_within_reach_and_out_of_reach_the_torso_rests():
    for point, expected in ((CENTER, "within reach"), (FAR, "out of reach")):
        status, command = step(START, point)
        assert status == expected
        assert not command.dq_rad_s.any()
        assert command.stamp_s == 3.0


def test_the_torso_stands_up_straight_and_then_rests():
    q = START.copy()
    home = START[TORSO]
    q[TORSO] = np.deg2rad([12.0, -8.0])
    path = []
    for _ in range(60):
        dq = lean.upright(PARAMS, ROBOT.at(q), home, DT, 3.0).dq_rad_s
        assert np.linalg.norm(dq) <= np.deg2rad(15) + 1e-12
        assert not np.delete(dq, TORSO).any()
        q = q + DT * dq
        path.append(q[TORSO])
    directions = np.array(path[:10]) / np.linalg.norm(path[:10], axis=1, keepdims=True)
    np.testing.assert_allclose(directions, np.tile(np.array([12.0, -8.0]) / np.hypot(12, 8), (10, 1)), atol=1e-6)
    assert np.linalg.norm(q[TORSO] - home) < np.deg2rad(0.1)
    assert not lean.upright(PARAMS, ROBOT.at(q), home, DT, 3.0).dq_rad_s.any()
