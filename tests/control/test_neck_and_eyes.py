"""Neck and eyes in the kinematic loop (20 Hz), with the last stage of every command in it."""

import numpy as np
import pytest
from eyes import fixation_point

from control import limits, neck_and_eyes
from control.fixation import fixation_error, gaze_at
from control.head import carried_velocity
from control.limits import LimitParams
from control.neck_and_eyes import NeckAndEyesParams, joints
from pps_vision.robot.icub import home, icub_rig, load_icub, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.types import Array

DEG = np.pi / 180
DT = 0.05
PARAMS = NeckAndEyesParams()
BODIES = SelfCollision(load_icub())
AHEAD = np.array([-0.4, 0.0, 0.3])


def follow(robot: Robot, q: Array, p: Array, n: int, trunk: Array | None = None, compensates: bool = True) -> Array:
    """Postures (n, n_joints) of a robot whose trunk turns at `trunk` (n_joints,) rad/s."""
    last = None
    last_q = None
    qs = []
    turning = np.zeros(robot.n_joints) if trunk is None else trunk
    for k in range(n):
        posture = robot.at(q)
        qs.append(q)
        v = -compensates * carried_velocity(posture, p, turning)
        wanted = neck_and_eyes.step(PARAMS, posture, p, v, 0.5, k * DT, last)
        command = limits.limit(LimitParams(), BODIES, posture, wanted, last, last_q)
        np.testing.assert_allclose(command.dq_rad_s, wanted.dq_rad_s, atol=1e-4)  # nothing is left to limit
        last = command
        last_q = q
        q = q + DT * (command.dq_rad_s + turning)
    return np.array(qs)


def last_above(errors: Array, bound: float) -> float:
    """When an error is above its bound for the last time, s."""
    above = np.flatnonzero(errors > bound)
    return DT * (above[-1] + 1) if len(above) else 0.0


def test_eyes_settle_to_a_tenth_of_a_degree_and_the_neck_to_half_a_degree(robot, rng):
    rig = icub_rig(robot)
    settled = []
    while len(settled) < 15:
        lower = np.array([-55, -40, 5]) * DEG
        upper = np.array([55, 30, 90]) * DEG
        q, q_target = (
            set_gaze(robot, home(robot), yaw, pitch, vergence=vergence)
            for yaw, pitch, vergence in rng.uniform(lower, upper, (2, 3))
        )
        p = fixation_point(robot.at(q_target))
        view = rig.view(q)
        if p is None or not (view.left.sees(p) and view.right.sees(p)):
            continue
        qs = follow(robot, q, p, 40)
        neck = qs[:, joints(robot)[0]]
        eyes = np.array([fixation_error(robot.at(q), p) for q in qs])
        settled.append((last_above(eyes, 0.1 * DEG), last_above(np.abs(neck - neck[-1]).max(axis=1), 0.5 * DEG)))
    eyes_s, neck_s = np.transpose(settled)
    assert max(eyes_s) <= 0.75, "also what is near or far, aside or beyond what the eyes reach without the neck"
    assert np.median(neck_s) <= 0.75


def test_the_eyes_turn_back_as_the_neck_comes_and_all_rest_ahead(robot):
    """From eyes turned aside and a head on one side: the target stays fixated meanwhile."""
    q = set_gaze(robot, home(robot), tilt=-8 * DEG, version=15 * DEG, vergence=10 * DEG)
    (roll,) = robot.indices(("neck_roll",))
    q[roll] = 15 * DEG
    p = fixation_point(robot.at(q))
    qs = follow(robot, q, p, 60)
    assert max(fixation_error(robot.at(q), p) for q in qs) < 0.3 * DEG
    tilt, left, right = qs[-1][joints(robot)[1]]
    np.testing.assert_allclose([tilt, left + right, qs[-1][roll]], 0.0, atol=0.2 * DEG)
    assert np.abs(qs[-1] - q)[joints(robot)[0]].max() > 10 * DEG


def test_the_eyes_compensate_for_the_torso(robot):
    trunk = np.zeros(robot.n_joints)
    trunk[robot.indices(("torso_yaw", "torso_roll", "torso_pitch"))] = np.array([25, 10, 15]) * DEG
    q = gaze_at(robot, home(robot), AHEAD)
    with_it, without = (
        max(fixation_error(robot.at(q), AHEAD) for q in follow(robot, q, AHEAD, 20, trunk, compensates))
        for compensates in (True, False)
    )
    assert with_it < 0.3 * DEG
    assert without > 5 * with_it


@pytest.mark.parametrize("p", [(0.5, 0.3, 0.3), (-0.1, 0.0, -0.6), (-0.075, 0.0, 0.34), (-3.0, 0.0, 0.3)])
def test_what_cannot_be_fixated_leaves_the_head_within_its_limits(robot, p):
    """Behind the head, straight below, between the eyes, far away."""
    for q in follow(robot, home(robot), np.array(p), 60):
        assert np.all((q >= robot.lower_rad - 1e-8) & (q <= robot.upper_rad + 1e-8))
        left, right = q[joints(robot)[1][1:]]
        assert left - right > -1e-6


def test_joints_outside_their_limits_come_back(robot):
    neck, eyes = joints(robot)
    q = gaze_at(robot, home(robot), AHEAD)
    q[neck + eyes] = robot.upper_rad[neck + eyes] + 5 * DEG
    for k in range(60):
        q = q + DT * neck_and_eyes.step(PARAMS, robot.at(q), AHEAD, np.zeros(3), DT, k * DT, None).dq_rad_s
    assert np.all(q[neck + eyes] <= robot.upper_rad[neck + eyes] + 1e-6)
    assert fixation_error(robot.at(q), AHEAD) < 0.1 * DEG
