"""The arm in closed form against forward kinematics, iterative search and a general minimiser."""

import numpy as np
import pytest

from pps_vision.experiments.baselines.spherical_arm import SphericalArm
from pps_vision.robot.icub import load_icub
from pps_vision.robot.inverse_kinematics import solve_ik

ROBOT = load_icub()
LOWER, UPPER = np.deg2rad([[-95, 0, -20, 15], [10, 160, 80, 105]])  # J's
CHAINS = {side: ROBOT.chain(ROBOT.names.arm(side)[:4], f"{side}_palm") for side in ("left", "right")}


def palm(side, q):
    """Position by Pinocchio, not by the chain from which the solver was made."""
    full = np.zeros(ROBOT.n_joints)
    full[ROBOT.indices(ROBOT.names.arm(side)[:4])] = q
    return ROBOT.at(full).point(f"{side}_palm")


@pytest.fixture(params=["left", "right"])
def side(request):
    return request.param


@pytest.fixture
def arm(side):
    return SphericalArm.of(CHAINS[side], LOWER, UPPER)


@pytest.mark.parametrize("share_at_limits", [0.0, 0.4])
def test_positions_of_random_postures_are_reached(arm, side, rng, share_at_limits):
    """At a joint's limit rounding decides."""
    q = rng.uniform(LOWER, UPPER, (300, 4))
    limits = np.where(rng.random(q.shape) < 0.5, LOWER, UPPER)
    q = np.where(rng.random(q.shape) < share_at_limits, limits, q)
    points = np.array([palm(side, posture) for posture in q])
    solutions = arm.solve(points)
    assert ((solutions >= LOWER) & (solutions <= UPPER)).all()
    np.testing.assert_allclose([palm(side, posture) for posture in solutions], points, atol=1e-9)


def test_unreachable_points_are_not_found_by_least_squares(arm, side, rng):
    """Points about the shoulder: a solution reaches its point; without one, descent from sixteen starts fails."""
    points = arm.shoulder + rng.uniform(-0.4, 0.4, (400, 3))
    q = arm.solve(points)
    is_far = np.isnan(q[:, 0])
    assert 0.3 < is_far.mean() < 0.95
    np.testing.assert_allclose([palm(side, posture) for posture in q[~is_far]], points[~is_far], atol=1e-9)
    starts = rng.uniform(LOWER, UPPER, (16, int(is_far.sum()), 4))
    searched = solve_ik(CHAINS[side].positions, points[is_far], starts, LOWER, UPPER)
    assert not searched.converged.any()
