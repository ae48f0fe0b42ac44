"""Damped least squares against the least-squares solution it approximates, and its limits."""

import numpy as np
from data import SEED

from control.arm import ArmParams
from pps_vision.experiments.stages.arm import Task, damped_least_squares
from pps_vision.robot.icub import HOME_ARM_RAD, home, load_icub
from pps_vision.robot.self_collision import SelfCollision

ROBOT = load_icub()
BODIES = SelfCollision(ROBOT)
POINT = np.array([-0.02, -0.05, 0.01])
REST = np.array(HOME_ARM_RAD)
ARM = ROBOT.indices(ROBOT.names.arm("left"))


def test_with_little_damping_the_point_moves_as_asked_and_the_rest_goes_home():
    q = home(ROBOT)
    velocity = 0.01 * np.random.default_rng(SEED).normal(size=3)
    q[ARM[5:]] += 0.1  # the wrist, which the forearm's point leaves free
    task = Task(ROBOT, BODIES, "left", "left_forearm", POINT, q, velocity)
    dq = damped_least_squares(ROBOT.at(q), task, damping_m=1e-4)
    J = ROBOT.at(q).jacobian("left_forearm", POINT)[:3]
    np.testing.assert_allclose(J @ dq, velocity, atol=1e-6)
    np.testing.assert_allclose(dq[ARM[5:]], -0.1 * ArmParams().posture_per_s, atol=1e-6)
    assert not np.any(np.delete(dq, ARM))


def test_rates_are_finite_at_a_singular_posture_and_clipped_at_the_limits():
    q = home(ROBOT)
    q[ARM] = np.where(np.arange(7) == 3, ROBOT.lower_rad[ARM], 0.0)
    outwards = 10 * (ROBOT.at(q).point("left_forearm", POINT) - ROBOT.at(q).point("left_upper_arm"))
    task = Task(ROBOT, BODIES, "left", "left_forearm", POINT, q, outwards)
    for hold_s, stays in ((None, False), (0.5, True)):
        dq = damped_least_squares(ROBOT.at(q), task, hold_s, REST - 1.0)
        assert np.abs(dq).max() <= ArmParams().max_rate_rad_s + 1e-9
        end = q + 0.5 * dq
        assert np.array_equal(ROBOT.clamp(end), end) == stays
