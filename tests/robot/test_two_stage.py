"""Reach, then improve: against the arm in closed form."""

import numpy as np
from data import SEED

from pps_vision.experiments.baselines.spherical_arm import SphericalArm
from pps_vision.robot.icub import load_icub
from pps_vision.robot.inverse_kinematics import IKParams, IKSolution
from pps_vision.robot.self_motion import FarFromLimits, TwoStageParams, best_of_starts, two_stage

ROBOT = load_icub()
LOWER, UPPER = np.deg2rad([-95.0, 0, -20, 15]), np.deg2rad([10.0, 160, 80, 105])  # J's
CHAIN = ROBOT.chain(ROBOT.names.arm("left")[:4], "left_palm")
ARM = SphericalArm.of(CHAIN, LOWER, UPPER)
EFFORT = FarFromLimits(LOWER, UPPER)


def problems(n, n_starts):
    """Points about the shoulder, half of them out of reach, and random starts."""
    rng = np.random.default_rng(SEED)
    return ARM.shoulder + rng.uniform(-0.3, 0.3, (n, 3)), rng.uniform(LOWER, UPPER, (n_starts, n, 4))


def sure(points):
    """Verdicts that no tolerance changes: the points around, a millimetre away, all have the same."""
    around = points[:, None] + 1e-3 * np.concatenate([np.eye(3), -np.eye(3)])
    reachable_around = np.isfinite(ARM.solve(around.reshape(-1, 3))[:, 0]).reshape(len(points), 6)
    return reachable_around.all(axis=1) | ~reachable_around.any(axis=1)


def test_the_batch_against_the_closed_form():
    points, starts = problems(400, 6)
    solutions = two_stage(CHAIN.positions, points, starts, LOWER, UPPER, EFFORT)
    _, effort = ARM.least_effort(points)
    reachable = np.isfinite(effort)
    assert 0.2 < reachable.mean() < 0.8
    assert not (solutions.reachable & ~reachable)[sure(points)].any()
    assert (solutions.reachable == reachable).mean() >= 0.97, "six random starts (96.8–99.2 % with 2–4)"
    off = np.linalg.norm(CHAIN.positions(solutions.q_rad)[0] - points, axis=1)
    assert (off[solutions.reachable] <= 1e-4).all()
    np.testing.assert_allclose(off[~solutions.reachable], solutions.error[~solutions.reachable], atol=1e-9)
    np.testing.assert_allclose(
        solutions.quality[solutions.reachable], EFFORT(solutions.q_rad[solutions.reachable], None), atol=1e-12
    )
    assert np.all((solutions.q_rad >= LOWER) & (solutions.q_rad <= UPPER))
    all_starts = solutions.reachable & reachable
    short = (1 - effort[all_starts]) - solutions.quality[all_starts]
    assert short.min() > -5e-3, "better than the best: only by what the tolerance allows"
    assert np.quantile(short, 0.95) < 0.01
    assert np.isnan(solutions.quality[~solutions.reachable]).all()


def test_what_does_not_converge_is_not_called_reachable():
    points, starts = problems(200, 1)
    hasty = TwoStageParams(reach=IKParams(tolerance=1e-4, max_steps=1))
    solutions = two_stage(CHAIN.positions, points, starts, LOWER, UPPER, EFFORT, hasty)
    assert solutions.reachable.sum() == (solutions.error <= 1e-4).sum() < 20
    assert np.isfinite(solutions.error).all()


def test_the_best_of_what_stages_give_by_hand():
    """Three starts: the first target is reached by two of them, the second by none; the third by the last."""
    starts = np.arange(9.0).reshape(3, 3, 1)
    errors = np.array([[0.05, 3.0, 2.0], [0.01, 1.0, 4.0], [0.03, 2.0, 0.06]])
    stage = iter([IKSolution(q, error, error < 0.1) for q, error in zip(starts + 0.5, errors, strict=True)])
    quality = {0.5: 0.2, 3.5: 0.1, 6.5: 0.3, 8.5: -5.0}

    def improve(targets, q):
        return q + 100 * targets, np.array([quality[angle] for angle in q[:, 0]])

    solutions = best_of_starts(lambda targets, start: next(stage), improve, np.array([[1.0], [2.0], [3.0]]), starts)
    np.testing.assert_allclose(solutions.q_rad[:, 0], [106.5, 4.5, 308.5])
    np.testing.assert_allclose(solutions.error, [0.01, 1.0, 0.06])
    np.testing.assert_array_equal(solutions.reachable, [True, False, True])
    np.testing.assert_allclose(solutions.quality, [0.3, np.nan, -5.0])
