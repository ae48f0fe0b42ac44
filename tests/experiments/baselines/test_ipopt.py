"""IPOPT, one problem at a time, against the arm in closed form."""

import numpy as np
from data import SEED

from pps_vision.experiments.baselines.ipopt import two_stage_by_ipopt
from pps_vision.experiments.reach_truth import closed_form
from pps_vision.robot.icub import load_icub
from pps_vision.robot.self_motion import FarFromLimits, TwoStageParams


def test_the_best_posture_is_found_within_reach_and_none_out_of_it():
    """Points that are more than a millimetre from the border of the reachable space."""
    robot = load_icub()
    arm = closed_form(robot, "left")
    chain = robot.chain(robot.names.arm("left")[:4], "left_palm")
    measure = FarFromLimits(arm.lower_rad, arm.upper_rad)
    rng = np.random.default_rng(SEED)
    points = arm.shoulder + rng.uniform(-0.3, 0.3, (8, 3))
    starts = rng.uniform(arm.lower_rad, arm.upper_rad, (2, 8, 4))
    around = points[:, None] + 1e-3 * np.concatenate([np.eye(3), -np.eye(3)])
    near = np.isfinite(arm.solve(around.reshape(-1, 3))[:, 0]).reshape(len(points), 6)
    certain = near.all(axis=1) | ~near.any(axis=1)
    solution = two_stage_by_ipopt(chain, points, starts, measure, TwoStageParams())
    _, effort = arm.least_effort(points)
    reachable = np.isfinite(effort)
    assert not (solution.reachable & ~reachable & certain).any()
    assert solution.reachable[reachable & certain].mean() >= 0.5, "two starts do not find all"
    reached = solution.reachable & reachable
    assert reached.any()
    assert (solution.quality[reached] <= 1 - effort[reached] + 5e-3).all()
    assert np.linalg.norm(chain.positions(solution.q_rad[reached])[0] - points[reached], axis=1).max() <= 1e-4
    np.testing.assert_allclose(solution.quality[reached], measure(solution.q_rad[reached], None), atol=1e-12)
