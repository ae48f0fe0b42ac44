"""The reachability of what is tracked, frame by frame, and how the report draws it."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from learning.reachable import Labels, ReachableMap
from pps_vision.app.demo import judged
from pps_vision.app.encounter import EncounterLog
from pps_vision.app.figures import encounters
from pps_vision.robot.gaze import GazeLimits, fixation_point, gaze_for_points
from pps_vision.robot.icub import home, load_icub, set_gaze
from pps_vision.types import Status

ROBOT, T = load_icub(), 12
LIMITS = GazeLimits(pitch_rad=(np.deg2rad(-80), np.deg2rad(40)))


@pytest.fixture
def log() -> EncounterLog:
    """Eyes that turn from left to right; in the last three frames nothing is tracked; tilt joins in."""
    yaw = np.deg2rad(np.linspace(-40, 40, T))
    q = np.array([set_gaze(ROBOT, home(ROBOT), y, np.deg2rad(-30), np.deg2rad(-5), 0.0, np.deg2rad(15)) for y in yaw])
    track = np.where(np.arange(T)[:, None] < T - 3, 0.0, np.nan) * np.ones(3)
    zeros, ones = np.zeros(T), np.ones((T, 2))
    return EncounterLog(
        "turning", ("a:1", "a:2"), 0.05 * np.arange(T), (Status.TRACKING,) * T, 0 * track, track, 0 * track, 0.1 * ones,
        0.2 * ones, zeros, zeros > 0, ones > 2, q,
    )  # fmt: skip


@pytest.fixture
def left_half() -> ReachableMap:
    """A map by which what lies at negative yaw is within reach."""
    yaw = np.linspace(*LIMITS.yaw_rad, 41)
    signed = -yaw[:, None, None] * np.ones((41, 5, 5))
    none = Labels(np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0), np.zeros(0), np.zeros((0, 3)))
    return ReachableMap("left", LIMITS, signed, 0.6 + 0 * signed, 0.2 + 0 * signed, 0.4, 0.01, 0.0, none)


def test_every_tracked_frame_is_judged_by_what_the_eyes_fixate(log: EncounterLog, left_half: ReachableMap) -> None:
    verdict = judged(ROBOT, left_half, log)
    assert verdict.within_limits.tolist() == [True] * (T - 3) + [False] * 3
    points = np.array([fixation_point(ROBOT.at(q)) for q in log.q_rad])
    gaze = gaze_for_points(ROBOT, points, LIMITS)
    known = slice(None, T - 3)
    assert verdict.reachable[known].tolist() == (gaze[known, 0] < 0).tolist()
    np.testing.assert_allclose(verdict.degree[known], np.where(gaze[known, 0] < 0, 0.8, 0.25), atol=0.02)


def test_a_turned_torso_does_not_change_it(log: EncounterLog, left_half: ReachableMap) -> None:
    """It carries hand and eyes alike."""
    q = log.q_rad.copy()
    q[:, ROBOT.indices(ROBOT.names.torso)] = 0.3
    before, after = judged(ROBOT, left_half, log), judged(ROBOT, left_half, replace(log, q_rad=q))
    np.testing.assert_allclose(after.degree, before.degree, atol=1e-9)


def test_the_report_draws_it_beside_the_activations(log: EncounterLog, left_half: ReachableMap) -> None:
    verdict = judged(ROBOT, left_half, log)
    figure = encounters([log], 0.4, [verdict])
    assert isinstance(figure, Figure)
    curve = figure.axes[3].lines[0]
    np.testing.assert_array_equal(curve.get_ydata(), verdict.degree)
    assert figure.axes[3].get_ylabel().startswith("degree of reach")
