"""Cartesian velocities of points of the arm, checked on the integrated motion."""

import numpy as np
import pytest

from control.arm import ArmParams, KeepIn, MovingPoint, arm_constraints, arm_velocity
from pps_vision.robot.icub import HOME_ARM_DEG, home
from pps_vision.robot.model import Robot
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.types import Array

DEG = np.pi / 180
DT = 0.05
PARAMS = ArmParams()
REST = np.deg2rad(HOME_ARM_DEG)


def rates(
    robot: Robot, q: Array, point: MovingPoint, *constraints: object, side: str = "left", params: ArmParams = PARAMS
) -> Array:
    """Joint rates that move a point of an arm whose rest posture is home."""
    posture = robot.at(q)
    return arm_velocity(params, posture, arm_constraints(params, posture, side, REST, *constraints), [point])


def posture_inside(robot: Robot, rng: np.random.Generator) -> Array:
    """A posture whose arm joints are in the middle 60 % of their ranges."""
    middle = 0.5 * (robot.upper_rad + robot.lower_rad)
    half = 0.5 * (robot.upper_rad - robot.lower_rad)
    return middle + half * rng.uniform(-0.6, 0.6, robot.n_joints)


@pytest.mark.parametrize(("side", "frame"), [("left", "left_forearm"), ("right", "right_palm")])
def test_a_point_moves_as_asked_and_only_its_arm_with_it(robot, rng, side, frame):
    point = np.array([-0.02, -0.03, 0.01])
    h = 1e-5
    deviations = []
    arm = robot.indices(robot.names.arm(side))
    for _ in range(40):
        q = posture_inside(robot, rng)
        direction = rng.normal(size=3)
        velocity = 0.02 * direction / np.linalg.norm(direction)
        dq = rates(robot, q, MovingPoint(frame, point, velocity), side=side)
        assert np.abs(dq).max() <= 60 * DEG + 1e-6
        assert not np.any(np.delete(dq, arm))
        moved = (robot.at(q + h * dq).point(frame, point) - robot.at(q).point(frame, point)) / h
        deviations.append(np.linalg.norm(moved - velocity) / 0.02)
    # the few that deviate are near a singular posture or at the 60°/s limit
    assert np.median(deviations) < 0.02
    assert np.quantile(deviations, 0.9) < 0.10


def test_what_the_task_leaves_free_goes_to_the_rest_posture(robot):
    """The elbow's velocity leaves the wrist free."""
    q = home(robot)
    wrist = robot.indices(("left_wrist_pitch", "left_wrist_yaw"))
    q[wrist] = (-30 * DEG, 15 * DEG)
    first = rates(robot, q, MovingPoint("left_lower_arm", (0, 0, 0), np.zeros(3)))
    np.testing.assert_allclose(first[wrist], (30 * DEG, -15 * DEG), atol=1e-4)  # remaining, per second
    for _ in range(100):
        q = q + DT * rates(robot, q, MovingPoint("left_lower_arm", (0, 0, 0), np.zeros(3)))
    np.testing.assert_allclose(q[wrist], 0.0, atol=1 * DEG)


def test_the_palm_slides_along_its_sphere(robot):
    """Pushed askew against the sphere it goes on sideways, and stays inside."""
    q = home(robot)
    center = robot.at(q).point("left_palm")
    keep_in = KeepIn("left_palm", center, 0.05)
    out = np.array([0.0, 0.0, 1.0])
    side = np.array([0.0, 1.0, 0.0])
    for _ in range(60):
        velocity = 0.1 * (out + 0.5 * side)
        q = q + DT * rates(robot, q, MovingPoint("left_palm", (0, 0, 0), velocity), keep_in)
        assert np.linalg.norm(robot.at(q).point("left_palm") - center) < 0.051
    offset = robot.at(q).point("left_palm") - center
    assert np.linalg.norm(offset) > 0.048
    assert offset @ side > 0.015


def test_a_palm_outside_its_sphere_is_brought_back(robot):
    """By a quarter of the way in each 50 ms: five times the distance per second."""
    q = home(robot)
    center = robot.at(q).point("left_palm") + np.array([0.0, 0.0, 0.08])
    keep_in = KeepIn("left_palm", center, 0.05)
    outside_m = []
    for _ in range(40):
        q = q + DT * rates(robot, q, MovingPoint("left_forearm", (0, 0, 0), np.zeros(3)), keep_in)
        outside_m.append(np.linalg.norm(robot.at(q).point("left_palm") - center) - 0.05)
    assert outside_m[0] == pytest.approx(0.75 * 0.03, rel=0.03)
    assert outside_m[-1] < 0.0005


def test_the_palm_slides_along_the_trunk(robot):
    """Pushed askew against the trunk it goes on sideways at 25 mm from it; without the rows it would run into it."""
    bodies = SelfCollision(robot)
    palm = "left_palm"
    gaps = {}
    velocity = np.array([0.1, 0.06, 0.0])  # the trunk lies behind the palm, the left of the robot is at −y
    for avoided in (bodies, None):
        q = home(robot)
        begun = robot.at(q).point(palm)
        for _ in range(60):
            q = q + DT * rates(robot, q, MovingPoint(palm, (0, 0, 0), velocity), None, DT, avoided)
            gaps.setdefault(avoided, []).append(bodies.distance_m(q))
        if avoided:
            assert abs((robot.at(q).point(palm) - begun)[1]) > 0.05
    assert min(gaps[bodies]) > 0.0245
    assert min(gaps[bodies]) < 0.026, "it comes as near as it may"
    assert min(gaps[None]) < 0.02


def test_from_any_start_also_outside_limits_there_are_rates_that_lead_back(robot, rng):
    """Some postures overlap with the trunk or the other arm: joint limits go before the distance."""
    bodies = SelfCollision(robot)
    arm = robot.indices(robot.names.arm("left"))
    for _ in range(40):
        q = rng.uniform(robot.lower_rad, robot.upper_rad)
        q[arm] += rng.choice([-0.3, 0.0, 0.3], len(arm))
        keep_in = KeepIn("left_palm", rng.uniform(-0.3, 0.3, 3), 0.05)
        velocity = rng.normal(size=3)
        dq = rates(robot, q, MovingPoint("left_palm", (0, 0, 0), velocity), keep_in, DT, bodies)
        assert np.all(np.abs(dq) <= 60 * DEG + 1e-6)
        beyond = [np.maximum(np.maximum(p - robot.upper_rad, robot.lower_rad - p), 0.0) for p in (q, q + DT * dq)]
        assert np.all(beyond[1][arm] <= np.maximum(beyond[0][arm] - DT * 60 * DEG, 0.0) + 1e-6)


@pytest.mark.parametrize("velocity", [(np.nan, 0, 0), (0, np.inf, 0), (0.1, 0)])
def test_a_velocity_that_is_not_finite_is_refused(robot, velocity):
    with pytest.raises(ValueError, match="expected three finite numbers"):
        rates(robot, home(robot), MovingPoint("left_palm", (0, 0, 0), velocity))
