"""Other end points and measures: against the arm in closed form and plain geometry."""

from dataclasses import replace

import numpy as np
import pytest
from data import SEED

from learning.reach.labels import ReachOracle, hand_and_params
from learning.reach.params import MapParams
from pps_vision.experiments.baselines.spherical_arm import SphericalArm
from pps_vision.robot.gaze import GazeLimits, fixation_points, gaze_for_points
from pps_vision.robot.icub import load_icub
from pps_vision.robot.self_motion import DirectionCoverage, FarFromLimits
from pps_vision.robot.skin import EndPoint

ROBOT = load_icub()
LIMITS = GazeLimits(pitch_rad=(np.deg2rad(-80), np.deg2rad(40)))  # arms are seen from above
PARAMS = MapParams(LIMITS, n_labels=800, round_labels=200, n_babble=20_000)


def best_measure(side, end_point, params, gaze):
    """(N,) measure of the best of 121 postures on each curve that reaches a fixation point; NaN out of reach."""
    limits = params.arm_limits
    lower = np.array(limits.lower_rad)
    upper = np.array(limits.upper_rad)
    point = EndPoint.of(ROBOT, side, end_point, 4)
    tip = point.chain.T_root_frame.copy()
    tip[:3, 3] += tip[:3, :3] @ point.point
    arm = SphericalArm.of(replace(point.chain, T_root_frame=tip), lower, upper)
    places = fixation_points(ROBOT, gaze)
    curves = np.concatenate([arm.curves(places, 121), arm.solve(places)[:, None]], axis=1)
    best = np.full(len(gaze), np.nan)
    for k, curve in enumerate(curves):
        q = curve[np.isfinite(curve[:, 0])]
        if len(q) and isinstance(params.measure, DirectionCoverage):
            near = np.cos(params.measure.within_rad)
            best[k] = (point.normals(q) @ params.measure.directions.T >= near).any(axis=0).mean()
        elif len(q):
            measure = params.measure or FarFromLimits(lower, upper)
            best[k] = measure(q, point.positions(q)[1]).max()
    return best


@pytest.mark.parametrize(
    ("side", "end_point", "measure", "tolerance"),
    [
        ("left", "left_forearm:27", "joint-limits", 0.05),
        ("right", "palm", "manipulability", 0.02),
        ("right", "palm", "isotropy", 0.02),
        ("right", "palm", "approach", 0.02),
    ],
)
def test_labels_are_what_the_whole_curve_says(side, end_point, measure, tolerance):
    rng = np.random.default_rng(SEED)
    hand, params = hand_and_params(ROBOT, side, end_point, measure, PARAMS)
    q = rng.uniform(params.arm_limits.lower_rad, params.arm_limits.upper_rad, (300, 4))
    within = gaze_for_points(ROBOT, hand.forward(q)[0], LIMITS)
    gaze = np.concatenate([within[np.isfinite(within[:, 0])], rng.uniform(LIMITS.lower, LIMITS.upper, (100, 3))])
    labels = ReachOracle(ROBOT, side, params, rng, hand).label(gaze)
    true = best_measure(side, end_point, params, gaze)
    assert np.mean(labels.reachable == np.isfinite(true)) >= 0.99
    agreed = labels.reachable & np.isfinite(true)
    assert agreed.sum() > 20
    off = (labels.optimality - true)[agreed]
    assert np.sqrt(np.mean(off**2)) <= tolerance
    assert true[agreed].min() >= 0
    assert true[agreed].max() <= 1.01  # the greatest manipulability is the greatest of 20 000 sampled


def test_directions_are_spread_evenly():
    directions = DirectionCoverage().directions
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    np.testing.assert_allclose(directions.mean(axis=0), 0, atol=0.01)
    cap = directions @ np.array([0.6, 0.0, 0.8]) >= np.cos(np.deg2rad(20))
    assert cap.mean() == pytest.approx((1 - np.cos(np.deg2rad(20))) / 2, rel=0.2)  # a cap's share of the sphere


def test_how_a_hand_faces_must_be_known():
    hand, params = hand_and_params(ROBOT, "right", "palm", "approach", PARAMS)
    blind = ReachOracle(ROBOT, "right", params, np.random.default_rng(0), replace(hand, normals=None))
    with pytest.raises(ValueError, match="expected its normals"):
        blind.label(np.deg2rad([[10.0, -20.0, 30.0]]))
