"""The random search looks to all sides of its centre, the covering one everywhere in bounded time."""

import numpy as np
import pytest

from control.fixation import gaze_at
from control.head import gaze_of
from control.search import SearchParams, SearchState, step
from pps_vision.app.pipeline import PipelineParams
from pps_vision.robot.gaze import fixation_points
from pps_vision.robot.icub import home, icub_rig, set_gaze
from pps_vision.robot.model import Robot
from pps_vision.types import Array

DEG = np.pi / 180
DT = 0.05
RANDOM = SearchParams("random")
COVERS_WITHIN_S = PipelineParams.search_for_s


def looked(robot: Robot, q: Array, n: int, seed: int = 0, params: SearchParams = RANDOM) -> Array:
    """Postures (n, n_joints) of a search that begins at `q`."""
    rng = np.random.default_rng(seed)
    qs = []
    state = SearchState(gaze_of(robot.at(q)))
    for _ in range(n):
        state, command = step(params, state, robot.at(q), DT, rng)
        q = q + DT * command.dq_rad_s
        assert np.all((q >= robot.lower_rad - 1e-9) & (q <= robot.upper_rad + 1e-9))
        qs.append(q)
    return np.array(qs)


@pytest.mark.parametrize("start", [(0.0, 0.0, 5.0), (54.0, 29.0, 5.0), (-50.0, -39.0, 90.0)])
@pytest.mark.parametrize(
    ("pitch_deg", "vergence_deg", "within_s"),
    [((-70, 40), 46, 0.5 * COVERS_WITHIN_S), ((-40, 30), 90, COVERS_WITHIN_S)],
    ids=("from 8 cm on", "from 3 cm on"),
)
def test_whatever_can_be_fixated_is_in_view_of_both_eyes_in_time(robot, rng, start, pitch_deg, vergence_deg, within_s):
    """At the first visit to the grid points 8–80 cm away, which a gaze within J's limits fixates, or above and below
    those with the eyes' tilt; at the second also nearer ones, to J's largest vergence."""
    gaze = rng.uniform([-55, pitch_deg[0], 5], [55, pitch_deg[1], vergence_deg], (500, 3)) * DEG
    points = fixation_points(robot, gaze)
    in_view = np.zeros(500, bool)
    q = set_gaze(robot, home(robot), yaw=start[0] * DEG, pitch=start[1] * DEG, vergence=start[2] * DEG)
    rig = icub_rig(robot)
    for q_now in looked(robot, q, int(within_s / DT), params=SearchParams())[::2]:
        view = rig.view(q_now)
        pixels = [eye.project(points) for eye in (view.left, view.right)]
        in_view |= np.logical_and.reduce([((px >= 0) & (px <= (319, 239))).all(axis=1) for px in pixels])
    assert in_view.all()


def test_it_looks_to_all_sides_of_its_centre_at_its_own_speed(robot):
    q = gaze_at(robot, home(robot), (-0.4, 0.05, 0.25))
    center = gaze_of(robot.at(q))
    rng = np.random.default_rng(1)
    goals = [step(RANDOM, SearchState(center), robot.at(q), DT, rng)[0].goal - center for _ in range(1000)]
    np.testing.assert_allclose(np.abs(goals).max(axis=0)[0], 30 * DEG, rtol=0.01)
    np.testing.assert_allclose(np.abs(np.sum(np.array(goals)[:, 1:3], axis=1)).max(), 20 * DEG, rtol=0.01)
    gazes = np.array([gaze_of(robot.at(q)) for q in looked(robot, q, 1200, seed=1)])
    aside = gazes[:, 0] - center[0]
    up = gazes[:, 1] + gazes[:, 2] - center[1] - center[2]
    for angles, least_deg, most_deg in ((aside, 20, 31), (up, 12, 21)):
        assert min(angles.max(), -angles.min()) > least_deg * DEG
        assert np.abs(angles).max() < most_deg * DEG
    assert np.abs(np.diff(gazes[:, :2], axis=0)).max() <= 30 * DEG * DT + 1e-9
    np.testing.assert_allclose(gazes[:, 3], center[3], atol=1e-9)


def test_below_the_necks_end_the_eyes_tilt_searches_on(robot):
    start = gaze_at(robot, home(robot), robot.at(home(robot)).point("left_forearm"))
    gazes = np.array([gaze_of(robot.at(q)) for q in looked(robot, start, 600, seed=2)])
    assert (gazes[:, 1] + gazes[:, 2]).min() < -60 * DEG
    assert gazes[:, 1].min() >= -40 * DEG - 1e-9


def test_held_for_half_a_second_no_joint_leaves_its_limits(robot):
    q = set_gaze(robot, home(robot), yaw=54 * DEG, pitch=29 * DEG, vergence=10 * DEG)
    ends = []
    for seed in range(20):
        state = SearchState(gaze_of(robot.at(q)))
        _, command = step(RANDOM, state, robot.at(q), 0.5, np.random.default_rng(seed))
        ends.append(q + 0.5 * command.dq_rad_s)
        assert command.hold_s == 0.5
    assert np.all((np.array(ends) >= robot.lower_rad - 1e-9) & (np.array(ends) <= robot.upper_rad + 1e-9))
    assert np.max(ends, axis=0)[robot.indices(("neck_yaw",))] == pytest.approx(55 * DEG)


@pytest.mark.parametrize("spacing", [(0.0, 0.1), (0.1, -0.1), (float("nan"), 0.1)])
def test_a_search_that_covers_nothing_is_refused(spacing):
    with pytest.raises(ValueError, match="expected covering or random, above 0"):
        SearchParams(spacing_rad=spacing)
    with pytest.raises(ValueError, match="search 'spiral'"):
        SearchParams("spiral")
