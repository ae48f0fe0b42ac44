"""One frame through the robot: posture, perception of moving taxels, gaze, refusals and counts."""

from dataclasses import replace

import numpy as np
import pytest
from known_track import DT, KnownTrack, KnownTracks, Motion, frame_at, run, touched_by_all, touched_on_course

from control.avoidance import AvoidanceParams
from control.fixation import FixationParams, fixation_error
from control.neck_and_eyes import NeckAndEyesParams
from learning.pps.memory import PPSMemory
from pps_vision.app.pipeline import Pipeline, PipelineParams, PipelineStep, TrackActivation
from pps_vision.errors import InputError
from pps_vision.robot.icub import HOME_ARM_RAD, home, icub_rig, load_icub
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array, StereoFrame
from tracking.tracker import Tracker, TrackerParams

ROBOT = load_icub()
TAXEL_3 = icub_skin(("left_forearm",)).index("left_forearm:3")


def pipeline(parts: tuple, params: PipelineParams | None = None) -> Pipeline:
    """A pipeline with the image tracker."""
    rng = np.random.default_rng(0)
    tracker = Tracker(TrackerParams(), icub_rig(ROBOT), rng)
    skin = icub_skin(parts)
    return Pipeline(params or PipelineParams(), ROBOT, skin, tracker, PPSMemory.empty(skin), rng)


@pytest.mark.parametrize(("part", "withdraws"), [("left_forearm", True), ("right_forearm", False)])
def test_an_unseen_touch_activates_by_itself_and_teaches_nothing(part, withdraws):
    """The arm that avoids withdraws from what it feels; the other one does not move it."""
    robot_pipeline = pipeline((part,))
    black = np.zeros((240, 320, 3), np.uint8)
    for k, touch in enumerate((None, np.arange(12) == 3, None)):
        step = robot_pipeline.step(StereoFrame(black, black, 0.05 * k, 0.05 * k, home(ROBOT), home(ROBOT)), touch)
        assert step.activation.probability[3] == (k == 1)
        if k == 1:
            assert step.command.dq_rad_s.any() == withdraws
    assert robot_pipeline.finish().counts.sum() == 0
    assert robot_pipeline.rejected == {"stale samples": 0, "unseen touches": 1}


def following(motion: Motion, params: PipelineParams | None = None, cov: Array | None = None) -> Pipeline:
    """A pipeline that knows the object's motion."""
    skin = icub_skin(("left_forearm",))
    rng = np.random.default_rng(0)
    tracker = KnownTrack(motion) if cov is None else KnownTrack(motion, cov)
    return Pipeline(params or PipelineParams(), ROBOT, skin, tracker, PPSMemory.empty(skin), rng)


def before_taxel_3(distance_m: float) -> Array:
    """A point before a taxel of the robot at home."""
    points, normals = icub_skin(("left_forearm",)).at(ROBOT.at(home(ROBOT)))
    return points[TAXEL_3] + distance_m * normals[TAXEL_3]


def anxious(distance_m: float, speed_m_s: float, cov: Array | None = None) -> Pipeline:
    """A skin that was touched by every object near it, and an object that approaches a taxel's place at home; it is
    `distance_m` from there in the third frame, the first with a time to contact."""
    velocity = speed_m_s * (before_taxel_3(0.0) - before_taxel_3(1.0))
    pipeline = following(lambda t: (before_taxel_3(distance_m + speed_m_s * (2 * DT - t)), velocity), cov=cov)
    learned = replace(pipeline._state.learning, memory=touched_by_all(icub_skin(("left_forearm",))))
    pipeline._state = replace(pipeline._state, learning=learned)
    return pipeline


def third_step(pipeline: Pipeline) -> PipelineStep:
    """The step of the third frame, in which the robot has not moved."""
    *_, step = (pipeline.step(frame_at(DT * k, home(ROBOT))) for k in range(3))
    return step


@pytest.mark.parametrize("gaze", [FixationParams(), NeckAndEyesParams()], ids=["J IV.1", "neck and eyes"])
@pytest.mark.parametrize("latency_s", [0.0, 0.2])
def test_gaze_follows_a_moving_object_without_lag(gaze, latency_s):
    """Posture and target are predicted; 0.3 m/s at 0.3 m would otherwise be 11° away after 0.2 s."""

    def motion(t: float) -> tuple[Array, Array]:
        return np.array([-0.35, -0.15 + 0.3 * t, 0.3]), np.array([0.0, 0.3, 0.0])

    params = PipelineParams(fixation=gaze, latency_s=latency_s)
    _, joints = run(following(motion, params), 1.0, latency_s)
    errors = [fixation_error(ROBOT.at(q), motion(DT * k)[0]) for k, q in enumerate(joints)]
    assert np.rad2deg(max(errors[-5:])) < 0.2


@pytest.mark.parametrize("stated_s", [0.0, 0.1])
@pytest.mark.parametrize(("true_s", "noise_deg"), [(0.0, 0.0), (0.0, 0.05), (0.1, 0.0), (0.1, 0.05)])
def test_a_latency_that_is_not_the_stated_one_is_reported_but_not_the_noise_of_the_encoders(
    stated_s, true_s, noise_deg
):
    """The eyes follow an object; readings are steps of an encoder."""
    params = PipelineParams(latency_s=stated_s)
    pipeline = following(lambda t: (np.array([-0.35, -0.15 + 0.1 * t, 0.3]), np.array([0.0, 0.1, 0.0])), params)
    accepted = pipeline.step

    def noisy(frame: StereoFrame) -> PipelineStep:
        step_rad = np.deg2rad(noise_deg)
        q = np.round(frame.joints_left_rad / step_rad) * step_rad if noise_deg else frame.joints_left_rad
        return accepted(replace(frame, joints_left_rad=q, joints_right_rad=q))

    pipeline.step = noisy
    steps, joints = run(pipeline, 2.0, true_s)
    assert np.abs(joints[-1] - joints[0]).max() > np.deg2rad(5)
    reported = [k for k, step in enumerate(steps) if step.mismatch_rad > 0]
    if stated_s == true_s:
        assert reported == []
    else:
        assert reported[0] <= 4
        assert np.rad2deg(max(step.mismatch_rad for step in steps)) > 1.0


def test_gaze_searches_for_the_given_time_after_the_object_was_lost_and_then_keeps_still():
    target = np.array([-0.35, 0.0, 0.3]), np.zeros(3)
    params = PipelineParams(search_for_s=0.6)
    steps, _ = run(following(lambda t: target if t < 0.475 else None, params), 1.5)
    moving = [bool(step.command.dq_rad_s.any()) for step in steps]
    assert all(moving[10:21]), "lost after the frame at 0.45 s: a search up to 1.0 s"
    assert not any(moving[21:])
    never_seen, _ = run(following(lambda t: None, params), 0.3)
    assert not any(step.command.dq_rad_s.any() for step in never_seen)


def test_a_contact_that_goes_on_is_learned_at_the_end():
    velocity = before_taxel_3(0.0) - before_taxel_3(0.1)
    pipeline = following(lambda t: (before_taxel_3(0.1) + t * velocity, velocity))
    touched = np.arange(12) == TAXEL_3
    for k in range(8):
        pipeline.step(frame_at(DT * k, home(ROBOT)), touched if k == 7 else None)
    assert pipeline.memory.counts.sum() == 0
    assert pipeline.finish().counts[TAXEL_3, ..., 0].sum() > 0
    assert pipeline.memory.counts.sum() > 0


@pytest.mark.parametrize("carried", [False, True])
def test_the_arms_own_motion_changes_no_time_to_contact(carried):
    """The object comes at 5 cm/s, 8 cm from the surface; the torso carries the forearm away meanwhile."""
    pipeline = anxious(0.1, 0.05)
    away = np.zeros(ROBOT.n_joints)
    away[ROBOT.indices(("torso_yaw",))] = 0.05 * carried
    for k in range(3):
        step = pipeline.step(frame_at(DT * k, home(ROBOT) + (2 - k) * away))
    assert step.events.ttc_s[TAXEL_3] == pytest.approx(1.6, rel=0.01)


@pytest.mark.parametrize(("stops", "expected_s"), [(False, 1.6), (True, np.inf)])
def test_the_closing_speed_is_that_of_the_positions_where_the_filter_overshoots(stops, expected_s):
    """Both say 5 cm/s; or the positions stand still."""
    pipeline = anxious(0.1, 0.05)
    if stops:
        motion = pipeline.tracker.motion
        pipeline.tracker = KnownTrack(lambda t: (before_taxel_3(0.1), motion(t)[1]))
    assert third_step(pipeline).events.ttc_s[TAXEL_3] == pytest.approx(expected_s)


def test_the_closing_speed_of_a_new_track_is_not_confirmed():
    events = anxious(0.1, 0.05).step(frame_at(0.0, home(ROBOT))).events
    assert events.ttc_s[TAXEL_3] == np.inf


def test_a_frame_that_is_refused_changes_nothing():
    pipeline = following(lambda t: None)
    pipeline.step(frame_at(0.0, home(ROBOT)))
    state_before = pipeline._state
    for frame, touched in (
        *((frame_at(stamp_s, home(ROBOT)), None) for stamp_s in (-0.05, np.nan, np.inf)),
        (replace(frame_at(DT, home(ROBOT)), joints_left_rad=None), None),
        (replace(frame_at(DT, home(ROBOT)), joints_right_rad=None), None),
        (frame_at(DT, np.full(ROBOT.n_joints, np.nan)), None),
        (frame_at(DT, home(ROBOT)), np.ones(3, bool)),
    ):
        with pytest.raises(ValueError, match="expected"):
            pipeline.step(frame, touched)
        assert pipeline._state is state_before


@pytest.mark.parametrize(("uncertain", "expected_s"), [("position", 1.6), ("velocity", np.inf)])
def test_an_uncertain_velocity_is_not_learned_from(uncertain, expected_s):
    """5 cm/s, 8 cm between the taxel and the surface."""
    variances = np.full((4, 3), 1e-6)
    variances[("position", "velocity").index(uncertain)] = 0.05**2 * 1.1
    step = third_step(anxious(0.1, 0.05, np.diag(variances.ravel())))
    assert step.events.ttc_s[TAXEL_3] == pytest.approx(expected_s)


@pytest.mark.parametrize(("sigma_m_s", "expected"), [(0.0, 1.0), (0.045, 1.0), (0.055, 0.0)])
def test_a_velocity_within_its_noise_activates_nothing(sigma_m_s, expected):
    """Closing at 5 cm/s."""
    step = third_step(anxious(0.1, 0.05, np.diag(np.repeat([1e-6, sigma_m_s**2, 1e-6, 1e-6], 3))))
    assert step.activation.probability[TAXEL_3] == pytest.approx(expected)


def uncertain(*variances: float) -> Array:
    """A covariance with these of the velocity, m²/s²."""
    return np.diag([*[1.0] * 3, *variances, *[1.0] * 6])


@pytest.mark.parametrize("cov", [uncertain(0.0, 1e-6, 1e-2), uncertain(-3e-12, 1e-6, 1e-2)], ids=["flat", "rounded"])
def test_a_velocity_that_is_certain_in_one_direction_can_be_acted_on(cov):
    anxious(0.1, 0.05, cov).step(frame_at(0.0, home(ROBOT)))


@pytest.mark.parametrize(
    "cov",
    [np.full((12, 12), np.nan), np.full((12, 12), np.inf), uncertain(1, 1, -1e-3), uncertain(1e-6, 1e-2, -1.2e-11)],
    ids=["NaN", "infinite", "indefinite", "hardly indefinite"],
)
def test_a_track_without_a_covariance_is_refused(cov):
    with pytest.raises(InputError, match="expected a positive semi-definite one"):
        anxious(0.1, 0.05, cov).step(frame_at(0.0, home(ROBOT)))


@pytest.mark.parametrize(("row", "value"), [(0, np.nan), (0, np.inf), (0, 1e300), (1, -1.2e6)])
def test_a_track_that_is_nowhere_is_refused(row, value):
    motion = np.array([[-0.3, 0.0, 0.2], [0.0, 0.0, 0.0]])
    motion[row, 1] = value
    with pytest.raises(InputError, match="expected finite numbers"):
        following(lambda t: (motion[0], motion[1])).step(frame_at(0.0, home(ROBOT)))


def test_commands_are_valid_for_the_time_asked_for_and_keep_the_limits():
    """Avoidance and fixation at joints near their limits: held to the end, none is passed."""
    for hold_s in (0.05, 0.5):
        pipeline = anxious(0.05, 0.1)
        pipeline.params = replace(pipeline.params, hold_s=hold_s)
        q = home(ROBOT)
        wrist = ROBOT.indices(("left_wrist_prosupination", "left_elbow", "neck_yaw"))
        q[wrist] = ROBOT.upper_rad[wrist] - 1e-3
        for k in range(20):
            step = pipeline.step(frame_at(DT * k, q))
            assert step.command.hold_s == hold_s
            end = q + hold_s * step.command.dq_rad_s
            assert np.all((end >= ROBOT.lower_rad) & (end <= ROBOT.upper_rad))
            q = q + min(DT, hold_s) * step.command.dq_rad_s
        assert step.response.mode == "avoid"
        assert np.any(step.command.dq_rad_s[ROBOT.indices(ROBOT.names.arm("left"))])


@pytest.mark.parametrize(("beside_m", "avoided"), [(0.0, True), (0.2, False)])
def test_an_object_whose_path_passes_by_is_not_avoided(beside_m, avoided):
    """It comes at 10 cm/s from 18 cm before a taxel, towards it or beside it."""
    towards = before_taxel_3(0.0) - before_taxel_3(0.1)
    aside = np.cross(towards, [0.0, 0.0, -1.0])
    way = beside_m * aside / np.linalg.norm(aside) + towards
    velocity = 0.1 * way / np.linalg.norm(way)
    skin = icub_skin(("left_forearm",))
    modes = []
    for memory in (touched_on_course(skin), touched_by_all(skin)):
        tracker = KnownTrack(lambda t: (before_taxel_3(0.18) + t * velocity, velocity))
        pipeline = Pipeline(PipelineParams(), ROBOT, skin, tracker, memory, np.random.default_rng(0))
        steps = [pipeline.step(frame_at(DT * k, home(ROBOT))) for k in range(18)]
        modes.append("avoid" in [step.response.mode for step in steps])
    assert modes == [avoided, True], "R's map does not know the path"


@pytest.mark.parametrize(("side", "arms"), [("right", "left"), ("left", "both"), ("right", "both")])
def test_the_arm_that_is_approached_avoids_if_asked_to(side, arms):
    """The taxels of two arms, and an object that comes to one: no joint of the other moves."""
    skin = icub_skin(("right_forearm", "left_forearm"))
    points, normals = skin.at(ROBOT.at(home(ROBOT)))
    index = skin.index(f"{side}_forearm:3")
    tracker = KnownTrack(lambda t: (points[index] + (0.06 - 0.1 * t) * normals[index], -0.1 * normals[index]))
    params = PipelineParams(other_arm=AvoidanceParams(HOME_ARM_RAD, "right") if arms == "both" else None)
    steps, joints = run(Pipeline(params, ROBOT, skin, tracker, touched_by_all(skin), np.random.default_rng(0)), 0.4)
    for arm, response in zip(("left", "right"), steps[-1].responses, strict=False):
        is_approached = arm == side
        assert response.mode == ("avoid" if is_approached else "idle")
        moved_rad = np.ptp(joints[:, ROBOT.indices(ROBOT.names.arm(arm))], axis=0).max()
        assert moved_rad > 0.01 if is_approached else moved_rad == 0


def two_arms(*motions: Motion, is_trained: bool = True) -> Pipeline:
    """Two arms that avoid, whose skin was touched by all that came near, and several objects."""
    skin = icub_skin(("right_forearm", "left_forearm"))
    memory = touched_by_all(skin) if is_trained else PPSMemory.empty(skin)
    params = PipelineParams(other_arm=AvoidanceParams(HOME_ARM_RAD, "right"))
    return Pipeline(params, ROBOT, skin, KnownTracks(motions), memory, np.random.default_rng(0))


def coming_to(side: str) -> Motion:
    """6 cm before a forearm at home, towards it at 10 cm/s."""
    skin = icub_skin((f"{side}_forearm",))
    points, normals = skin.at(ROBOT.at(home(ROBOT)))
    k = skin.index(f"{side}_forearm:3")
    return lambda t: (points[k] + (0.06 - 0.1 * t) * normals[k], -0.1 * normals[k])


def resting(t: float) -> tuple[Array, Array]:
    return np.array([-0.45, 0.1, 0.35]), np.zeros(3)


def test_of_several_objects_a_taxel_expects_the_likeliest_touch_and_each_arm_avoids_its_own():
    motions = coming_to("left"), coming_to("right"), resting
    alone = [third_step(two_arms(motion)).activation.probability for motion in motions]
    assert all(activation.max() > 0.9 for activation in alone[:2])
    step = third_step(two_arms(*motions))
    np.testing.assert_array_equal(step.activation.probability, np.max(alone, axis=0))
    steps, _ = run(two_arms(*motions), 0.4)
    assert [response.mode for response in steps[-1].responses] == ["avoid", "avoid"]


@pytest.mark.parametrize(("is_trained", "attended_id"), [(True, 2), (False, 1)])
def test_the_gaze_follows_the_object_that_most_probably_touches(is_trained, attended_id):
    """Without experience the one that the tracker attends."""
    motions = resting, lambda t: (before_taxel_3(0.15 - 0.05 * t), -0.05 * (before_taxel_3(1.0) - before_taxel_3(0.0)))
    pipeline = two_arms(*motions, is_trained=is_trained)
    left, right = pipeline._arms
    pipeline._arms = [left._replace(params=replace(left.params, threshold=1.0)), right]  # it keeps still
    steps, joints = run(pipeline, 1.0)
    assert [track.track_id for track in steps[-1].tracking.tracks] == [attended_id, 3 - attended_id]
    errors = [fixation_error(ROBOT.at(joints[-1]), motion(1.0)[0]) for motion in motions]
    assert np.rad2deg(errors[attended_id - 1]) < 3
    assert np.rad2deg(errors[2 - attended_id]) > 5


def test_a_track_without_a_pipeline_activates_the_skin_alike():
    motions = resting, coming_to("left")
    pipeline = two_arms(*motions)
    of_track = TrackActivation(ROBOT, pipeline.skin, pipeline.memory)
    for k in range(3):
        frame = frame_at(DT * k, home(ROBOT))
        step, activation, taxels = of_track(home(ROBOT), pipeline.tracker.step(frame))
        np.testing.assert_array_equal(activation.probability, pipeline.step(frame).activation.probability)
    assert activation.probability.max() > 0.9
    assert taxels.shape == (len(pipeline.skin.taxel_ids), 3)
    assert [track.track_id for track in step.tracks] == [2, 1]


def test_between_two_objects_that_come_the_gaze_does_not_flicker():
    """Whichever the tracker attends."""
    pipeline = two_arms(coming_to("left"), coming_to("right"))
    pipeline.tracker.attended = lambda t: 1 + round(t / DT) % 2
    attended = [pipeline.step(frame_at(DT * k, home(ROBOT))).tracking.track.track_id for k in range(8)]
    assert len(set(attended[3:])) == 1


def test_parameters_and_a_memory_that_contradict_the_robot_are_refused():
    skin = icub_skin(("left_forearm",))
    memory = PPSMemory.empty(skin)
    other = PPSMemory.empty(icub_skin(("left_forearm", "left_palm")))
    for params, taught, message in (
        (PipelineParams(other_arm=AvoidanceParams(HOME_ARM_RAD, "left")), memory, "other arm"),
        (PipelineParams(arm=AvoidanceParams(HOME_ARM_RAD[:6])), memory, "expected the 7 joints of the left arm"),
        (PipelineParams(), other, "memory has 16 taxels but the skin has 12"),
    ):
        with pytest.raises(ValueError, match=message):
            Pipeline(params, ROBOT, skin, KnownTrack(lambda t: None), taught, np.random.default_rng(0))
