"""One-at-a-time solvers against the arm in closed form."""

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments.baselines.inverse_kinematics import Solver, two_stage_by
from pps_vision.experiments.baselines.spherical_arm import SphericalArm
from pps_vision.robot.icub import load_icub
from pps_vision.robot.self_motion import FarFromLimits

ROBOT = load_icub()
LOWER, UPPER = np.deg2rad([-95.0, 0, -20, 15]), np.deg2rad([10.0, 160, 80, 105])  # J's
CHAIN = ROBOT.chain(ROBOT.names.arm("left")[:4], "left_palm")
ARM = SphericalArm.of(CHAIN, LOWER, UPPER)
EFFORT = FarFromLimits(LOWER, UPPER)


@pytest.mark.parametrize("solver", ["scipy", "ipopt"])
def test_no_posture_is_better_than_the_best_and_none_is_found_out_of_reach(solver: Solver):
    """Points that are more than a millimetre from the border of what is reachable."""
    rng = np.random.default_rng(SEED)
    points, starts = ARM.shoulder + rng.uniform(-0.3, 0.3, (8, 3)), rng.uniform(LOWER, UPPER, (2, 8, 4))
    around = points[:, None] + 1e-3 * np.concatenate([np.eye(3), -np.eye(3)])
    near = np.isfinite(ARM.solve(around.reshape(-1, 3))[:, 0]).reshape(len(points), 6)
    certain = near.all(axis=1) | ~near.any(axis=1)
    found = two_stage_by(solver, CHAIN, points, starts, EFFORT)
    _, effort = ARM.least_effort(points)
    reachable = np.isfinite(effort)
    assert not (found.reachable & ~reachable & certain).any()
    assert found.reachable[reachable & certain].mean() >= 0.5, "two starts do not find all"
    both = found.reachable & reachable
    assert both.any()
    assert (found.quality[both] <= 1 - effort[both] + 5e-3).all()
    assert np.linalg.norm(CHAIN.positions(found.q_rad[both])[0] - points[both], axis=1).max() <= 1e-4
    np.testing.assert_allclose(found.quality[both], EFFORT(found.q_rad[both], None), atol=1e-12)
