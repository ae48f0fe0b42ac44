"""Point D of J Fig 3, the closest posture that is reached and fixated: why 4400 random ones rarely come near it."""

import numpy as np

from learning.reach.params import ArmLimits
from pps_vision.robot.gaze import GazeModel
from pps_vision.robot.icub import load_icub


def test_the_closest_posture_is_where_j_has_it_and_too_rare_for_4400_samples() -> None:
    robot, limits, rng = load_icub(), ArmLimits(), np.random.default_rng(0)
    arm = robot.chain(robot.names.arm("right")[:4], "right_palm")
    q = rng.uniform(limits.lower_rad, limits.upper_rad, (300_000, 4))
    vergence = np.rad2deg(GazeModel(robot).gaze(arm.positions(q)[0])[:, 2])
    fixated = vergence[np.isfinite(vergence)]
    assert 1e-4 < (fixated > 67).mean() < 4e-4
    largest = [rng.choice(fixated, 4400).max() for _ in range(200)]
    assert 60 < np.median(largest) < 77
    # near the best of them the elbow is bent as J says, and the vergence approaches J's 89.15°
    best = q[np.nanargmax(vergence)]
    near = (best + rng.normal(0, 0.1, (100_000, 4))).clip(limits.lower_rad, limits.upper_rad)
    closer = np.rad2deg(GazeModel(robot).gaze(arm.positions(near)[0])[:, 2])
    assert 87 < np.nanmax(closer) <= 90
    assert np.rad2deg(near[np.nanargmax(closer), 3]) > 104
