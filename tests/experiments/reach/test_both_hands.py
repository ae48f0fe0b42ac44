"""The map of what both hands reach at once, against closed-form inverse kinematics of both arms."""

import numpy as np
import pytest

from learning.reach.map import both
from learning.reach.params import MapParams
from learning.reach.training import train_reachable_map
from pps_vision.experiments.reach.map_truth import closed_form
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import load_icub


@pytest.mark.long
def test_what_both_hands_reach_is_what_each_of_them_reaches() -> None:
    robot, params = load_icub(), MapParams(n_labels=800, round_labels=400, n_babble=10_000)
    maps = [train_reachable_map(robot, side, np.random.default_rng(1), params) for side in ("left", "right")]
    limits = maps[0].limits
    gaze = np.random.default_rng(7).uniform(limits.lower, limits.upper, (3000, 3))
    points = fixation_points(robot, gaze)
    reached = [np.isfinite(closed_form(robot, side).solve(points)[:, 0]) for side in ("left", "right")]
    found, true = both(*maps).query(gaze).reachable, reached[0] & reached[1]
    print(f"both {true.mean():.4f}, misjudged {(found != true).mean():.4f}, FP {(found & ~true).mean():.4f}")
    assert 0.01 < true.mean() < min(one.mean() for one in reached)
    assert (found != true).mean() < 0.15 * true.mean()  # 7 % measured, with few labels
