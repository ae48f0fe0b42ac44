"""Walking along the postures that leave the hand where it is; reaching, then improving: the arm in closed form."""

import numpy as np
import pytest
from data import SEED

from pps_vision.experiments.baselines.spherical_arm import SphericalArm
from pps_vision.robot.icub import load_icub
from pps_vision.robot.inverse_kinematics import IKParams
from pps_vision.robot.self_motion import (
    DirectionCoverage,
    FarFromLimits,
    Manipulability,
    TwoStageParams,
    WalkParams,
    covered_directions,
    two_stage,
    walk,
)

LOWER = np.full(3, -np.pi)
UPPER = np.full(3, np.pi)


def planar(q):
    """Three links of 1 m in a plane."""
    angles = np.cumsum(q, axis=1)
    ends = np.stack([np.cos(angles), np.sin(angles)], axis=1)  # (N, 2, 3)
    J = np.cumsum(np.stack([-ends[:, 1], ends[:, 0]], axis=1)[:, :, ::-1], axis=2)[:, :, ::-1]
    return ends.sum(axis=2), J


def test_it_walks_to_the_best_of_the_whole_curve():
    """Three links, a hand in the plane: the curve is known, its first angle parts it."""
    rng = np.random.default_rng(SEED)
    q = rng.uniform(-1.5, 1.5, (40, 3))
    targets, _ = planar(q)
    measure = FarFromLimits(LOWER, UPPER)
    walked, good = walk(planar, targets, q, LOWER, UPPER, measure, WalkParams(step_rad=0.15, steps=60))
    np.testing.assert_allclose(planar(walked)[0], targets, atol=1e-4)
    np.testing.assert_allclose(measure(walked, None), good)
    best = []
    for target in targets:
        first = np.linspace(-np.pi, np.pi, 4001)
        remaining = target - np.stack([np.cos(first), np.sin(first)], axis=1)  # two links are left, to reach this
        distance = np.linalg.norm(remaining, axis=1)
        bend = np.arccos(np.clip(distance**2 / 2 - 1, -1, 1))
        whole = []
        for sign in (-1, 1):
            second = np.arctan2(remaining[:, 1], remaining[:, 0]) - sign * bend / 2 - first
            angles = np.stack([first, (second + np.pi) % (2 * np.pi) - np.pi, sign * bend], axis=1)
            whole.append(measure(angles[distance <= 2], None))
        best.append(np.concatenate(whole).max())
    np.testing.assert_allclose(good, best, atol=1e-4)
    assert np.median(good - measure(q, None)) > 0.01


def test_postures_off_the_target_do_not_count():
    """Steps so long that two corrections do not bring the hand back, although the limits allow them."""
    rng = np.random.default_rng(SEED)
    q = rng.uniform(-1.5, 1.5, (300, 3))
    targets, _ = planar(q)
    walked, _ = walk(planar, targets, q, LOWER, UPPER, FarFromLimits(LOWER, UPPER), WalkParams(step_rad=1.5, steps=4))
    assert np.abs(walked - q).max() > 0.1
    assert np.linalg.norm(planar(walked)[0] - targets, axis=1).max() <= WalkParams().tolerance


def test_manipulability_is_the_volume_and_vanishes_where_the_arm_is_straight():
    _, J = planar(np.array([[0.3, 0.0, 0.0], [0.3, 1.2, 0.4]]))
    volume = Manipulability()(None, J)
    assert volume[0] == pytest.approx(0, abs=1e-9)
    assert volume[1] == pytest.approx(np.sqrt(np.linalg.det(J[1] @ J[1].T)))
    assert Manipulability(2.0)(None, J)[1] == pytest.approx(volume[1] / 2)
    even = Manipulability(isotropy=True)(None, J)
    assert even[0] == pytest.approx(0, abs=1e-9)
    assert even[1] == pytest.approx(1 / np.linalg.cond(J[1]))


def pointing(q):
    """Where the last link points."""
    angle = q.sum(axis=1)
    return np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)


def test_the_directions_that_a_hand_takes_in_the_plane_are_those_near_the_plane():
    """70 cm from its base three links of a metre reach a point from all sides, in the plane; within 20° of it."""
    towards, half = (
        np.arctan2(-1.0, 0.7),
        np.arccos(0.5 * np.hypot(1.0, 0.7)),
    )  # last joint, from the base
    q = np.array([[towards - half, 2 * half, np.pi / 2 - towards - half]])  # the last link points along y
    target, _ = planar(q)
    q = np.tile(q, (2, 1))
    wide = np.full(3, 20.0)
    coverage = DirectionCoverage()
    params = WalkParams(step_rad=0.1, steps=120)
    met = covered_directions(planar, pointing, np.tile(target, (2, 1)), q, -wide, wide, coverage, params)
    near = np.abs(coverage.directions[:, 2]) <= np.sin(np.deg2rad(20))
    assert met.shape == (2, 200)
    assert np.count_nonzero(met[0] != near) <= 1
    met = covered_directions(planar, pointing, np.tile(target, (2, 1)), q, q[0] - 1e-3, q[0] + 1e-3, coverage, params)
    np.testing.assert_array_equal(met[0], coverage.directions[:, 1] >= np.cos(np.deg2rad(20)))


ROBOT = load_icub()
ARM_LOWER, ARM_UPPER = np.deg2rad([-95.0, 0, -20, 15]), np.deg2rad([10.0, 160, 80, 105])  # J's
CHAIN = ROBOT.chain(ROBOT.names.arm("left")[:4], "left_palm")
ARM = SphericalArm.of(CHAIN, ARM_LOWER, ARM_UPPER)
EFFORT = FarFromLimits(ARM_LOWER, ARM_UPPER)


def problems(n, n_starts):
    """Points about the shoulder, half of them out of reach, and random starts."""
    rng = np.random.default_rng(SEED)
    return ARM.shoulder + rng.uniform(-0.3, 0.3, (n, 3)), rng.uniform(ARM_LOWER, ARM_UPPER, (n_starts, n, 4))


def sure(points):
    """Verdicts that no tolerance changes: the points around, a millimetre away, all have the same."""
    around = points[:, None] + 1e-3 * np.concatenate([np.eye(3), -np.eye(3)])
    reachable_around = np.isfinite(ARM.solve(around.reshape(-1, 3))[:, 0]).reshape(len(points), 6)
    return reachable_around.all(axis=1) | ~reachable_around.any(axis=1)


def test_the_batch_against_the_closed_form():
    points, starts = problems(400, 6)
    solutions = two_stage(CHAIN.positions, points, starts, ARM_LOWER, ARM_UPPER, EFFORT)
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
    assert np.all((solutions.q_rad >= ARM_LOWER) & (solutions.q_rad <= ARM_UPPER))
    all_starts = solutions.reachable & reachable
    short = (1 - effort[all_starts]) - solutions.quality[all_starts]
    assert short.min() > -5e-3, "better than the best: only by what the tolerance allows"
    assert np.quantile(short, 0.95) < 0.01
    assert np.isnan(solutions.quality[~solutions.reachable]).all()


def test_what_does_not_converge_is_not_called_reachable():
    points, starts = problems(200, 1)
    hasty = TwoStageParams(reach=IKParams(tolerance=1e-4, max_steps=1))
    solutions = two_stage(CHAIN.positions, points, starts, ARM_LOWER, ARM_UPPER, EFFORT, hasty)
    assert solutions.reachable.sum() == (solutions.error <= 1e-4).sum() < 20
    assert np.isfinite(solutions.error).all()
