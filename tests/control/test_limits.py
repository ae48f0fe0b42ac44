"""The last stage of every command, held throughout its validity; distances by coal at many points of the way."""

from dataclasses import replace

import numpy as np
import pytest

from control import fixation, lean, search
from control.arm import ArmParams, MovingPoint, arm_constraints, arm_velocity
from control.avoidance import ArmInput, ArmState, AvoidanceParams
from control.avoidance import step as avoid
from control.head import gaze_of
from control.limits import LimitParams, limit
from pps_vision.errors import InputError
from pps_vision.robot.gaze import GazeLimits, GazeModel
from pps_vision.robot.icub import HOME_ARM_RAD, home
from pps_vision.robot.model import Robot
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import icub_skin
from pps_vision.types import Array, JointVelocity, Track3D

PARAMS = LimitParams()
HOLD_S = 0.5
DT = 0.05
DEG = np.pi / 180
SKIN = icub_skin(("left_forearm",))


@pytest.fixture(scope="module")
def bodies(robot: Robot) -> SelfCollision:
    return SelfCollision(robot)


def command(robot: Robot, stamp_s: float = 0.0, hold_s: float = HOLD_S, **rates: float) -> JointVelocity:
    dq = np.zeros(robot.n_joints)
    for name, rate in rates.items():
        dq[robot.indices((name,))] = rate
    return JointVelocity(stamp_s, dq, hold_s)


def excess(robot: Robot, q: Array) -> Array:
    """(n_joints,) rad beyond the limits."""
    return np.maximum(np.maximum(q - robot.upper_rad, robot.lower_rad - q), 0.0)


def smallest_distance(bodies: SelfCollision, q: Array, held: JointVelocity) -> float:
    return min(bodies.distance_m(q + s * held.hold_s * held.dq_rad_s) for s in np.linspace(0, 1, 41))


@pytest.mark.parametrize("dt_s", [-0.05, 0.0, np.nan, 0.51, np.inf])
def test_a_holding_time_out_of_range_is_refused_by_every_controller(robot, bodies, dt_s):
    posture = robot.at(home(robot))
    rng = np.random.default_rng(0)
    arm = ArmInput(0.0, posture, SKIN, np.zeros(12), Track3D.unknown(0.0), hold_s=dt_s)
    for controller, *arguments in (
        (fixation.step, fixation.FixationParams(), posture, (-0.3, 0.0, 0.2), (0.0, 0.0, 0.0), dt_s),
        (search.step, search.SearchParams(), search.SearchState(gaze_of(posture)), posture, dt_s, rng),
        (
            lean.step,
            lean.LeanParams(),
            GazeModel(robot),
            GazeLimits(),
            lambda g: g[:, 0] > 0,
            posture,
            np.zeros(3),
            dt_s,
            0,
        ),
        (avoid, AvoidanceParams(HOME_ARM_RAD), ArmState(), arm),
        (limit, PARAMS, bodies, posture, command(robot, hold_s=dt_s)),
    ):
        with pytest.raises(InputError, match="command held for"):
            controller(*arguments)


@pytest.mark.parametrize("stamp_s", [np.nan, np.inf, -np.inf, 0.9])
def test_stamps_that_are_not_finite_or_go_back_are_refused_and_change_nothing(robot, bodies, stamp_s):
    params = AvoidanceParams(HOME_ARM_RAD, confirmation_s=0.0)
    arm = ArmInput(1.0, robot.at(home(robot)), SKIN, np.eye(12)[0], Track3D.unknown(1.0))
    state, first = avoid(params, ArmState(), arm)
    last = first.command
    with pytest.raises(InputError, match="does not go back"):
        avoid(params, state, replace(arm, stamp_s=stamp_s))
    with pytest.raises(InputError, match="does not go back"):
        limit(PARAMS, bodies, arm.posture, replace(last, stamp_s=stamp_s), last)
    _, repeated = avoid(params, state, arm)
    assert repeated.mode == "avoid"
    np.testing.assert_array_equal(repeated.command.dq_rad_s, last.dq_rad_s)


@pytest.mark.parametrize(
    "change", [{"joint_rad_s": 0.0}, {"eyes_rad_s": np.nan}, {"speed_up_s": 0.0}, {"clearance_m": -1.0}]
)
def test_impossible_limits_and_rates_are_refused(robot, bodies, change):
    with pytest.raises(InputError, match="expected rates and a time above 0"):
        replace(PARAMS, **change)
    for rates in (np.full(23, np.nan), np.r_[np.zeros(22), np.inf], np.zeros(22)):
        with pytest.raises(InputError, match="expected 23 finite numbers"):
            limit(PARAMS, bodies, robot.at(home(robot)), JointVelocity(0.0, rates, HOLD_S))


@pytest.mark.parametrize("outside_rad", [0.0, 0.3])
@pytest.mark.parametrize("hold_s", [0.02, 0.5])
def test_from_any_start_joints_and_rates_keep_their_limits_while_a_command_is_held(
    robot, rng, bodies, outside_rad, hold_s
):
    fastest = np.full(robot.n_joints, np.deg2rad(60))
    fastest[robot.indices(("eyes_tilt", "left_eye_pan", "right_eye_pan"))] = np.deg2rad(180)
    moved = 0
    for _ in range(60):
        q = rng.uniform(robot.lower_rad, robot.upper_rad)
        q = np.where(rng.random(robot.n_joints) < 0.1, robot.upper_rad + outside_rad, q)
        q = np.where(rng.random(robot.n_joints) < 0.1, robot.lower_rad - outside_rad, q)
        wanted = JointVelocity(0.0, rng.standard_normal(robot.n_joints) * (rng.random(robot.n_joints) < 0.3), hold_s)
        held = limit(PARAMS, bodies, robot.at(q), wanted)
        assert np.all(excess(robot, q + hold_s * held.dq_rad_s) <= excess(robot, q))
        assert np.all(np.abs(held.dq_rad_s) <= fastest + 1e-12)
        assert smallest_distance(bodies, q, held) >= min(bodies.distance_m(q), 0.02) - 2e-6
        moved += bool(np.any(held.dq_rad_s))
    assert moved > 20


def test_a_command_is_scaled_uniformly_and_the_head_apart_from_the_body(robot, bodies):
    q = home(robot)
    (roll,) = robot.indices(("left_shoulder_roll",))
    wanted = command(robot, left_shoulder_roll=6.0, right_elbow=1.0, torso_yaw=-0.5, neck_yaw=0.4, eyes_tilt=-0.2)
    held = limit(PARAMS, bodies, robot.at(q), wanted).dq_rad_s
    share = np.where(bodies.moving, held[roll] / 6.0, 1.0)
    assert held[roll] == pytest.approx(np.deg2rad(60))
    np.testing.assert_allclose(held, share * wanted.dq_rad_s, atol=1e-12)


def test_a_joint_at_its_limit_does_not_stop_the_others_by_rounding(robot, bodies):
    q = home(robot)
    q[robot.indices(("neck_pitch",))] = robot.lower_rad[robot.indices(("neck_pitch",))]
    for beyond, share in ((1e-8, 1.0), (0.9e-6, 1.0), (1.2e-6, 0.0)):
        held = limit(PARAMS, bodies, robot.at(q), command(robot, neck_pitch=-beyond, neck_yaw=0.3))
        np.testing.assert_allclose(held.dq_rad_s, share * command(robot, neck_yaw=0.3).dq_rad_s, atol=1e-2 * beyond)


def test_the_change_from_braking_is_as_large_as_the_limits_allow(robot, rng, bodies):
    """In free space one joint of each group reaches a limit, or all is as asked for."""
    posture = robot.at(home(robot))
    fastest = np.full(robot.n_joints, np.deg2rad(60))
    fastest[robot.indices(("eyes_tilt", "left_eye_pan", "right_eye_pan"))] = np.deg2rad(180)
    for _ in range(100):
        previous, wanted = (0.03 * rng.standard_normal(robot.n_joints) for _ in range(2))
        wanted *= rng.choice([1.0, 100.0])
        elapsed_s = rng.choice([0.001, 0.01])
        hold_s = rng.choice([0.1, 0.5])
        last = JointVelocity(0.0, previous, HOLD_S)
        held = limit(PARAMS, bodies, posture, JointVelocity(elapsed_s, wanted, hold_s), last).dq_rad_s
        brake = previous * min(1.0, (HOLD_S - elapsed_s) / hold_s)
        for group in (bodies.moving, ~bodies.moving):
            change = (held - brake)[group]
            way = (wanted - brake)[group]
            share = change @ way / (way @ way)
            np.testing.assert_allclose(change, share * way, atol=1e-9)
            room = np.where(held > 0, robot.upper_rad - posture.q_rad, posture.q_rad - robot.lower_rad)
            sudden = np.abs(held - previous) / (10 * fastest * elapsed_s)
            used = np.max([np.abs(held) / fastest, sudden, hold_s * np.abs(held) / room], axis=0)[group]
            assert used.max() <= 1 + 1e-9
            assert used.max() > 1 - 1e-6 or share == pytest.approx(1.0)


def test_a_joint_at_its_limit_is_not_turned_beyond_and_turns_back(robot, bodies):
    """Nor does it brake beyond, where it was pushed to it."""
    yaw, elbow = robot.indices(("neck_yaw", "left_elbow"))
    q = home(robot)
    q[yaw] = robot.upper_rad[yaw]
    q[elbow] = robot.upper_rad[elbow] + 0.2
    held = limit(PARAMS, bodies, robot.at(q), command(robot, 0.01, neck_yaw=1.0), command(robot, neck_yaw=1.0))
    assert held.dq_rad_s[yaw] == 0.0
    assert limit(PARAMS, bodies, robot.at(q), command(robot, left_elbow=-0.3)).dq_rad_s[elbow] == -0.3
    assert not limit(PARAMS, bodies, robot.at(q), command(robot, left_elbow=0.3)).dq_rad_s.any()


def test_braking_ends_where_the_last_command_would_have(robot, bodies):
    """Turned back in full flight just before its limit, the joint stops in front of it."""
    (yaw,) = robot.indices(("neck_yaw",))
    q = home(robot)
    dt = 0.005
    q[yaw] = robot.upper_rad[yaw] - 0.3
    last = limit(PARAMS, bodies, robot.at(q), command(robot, neck_yaw=5.0))
    assert last.dq_rad_s[yaw] == pytest.approx(0.6, abs=1e-6)
    rates = []
    for k in range(1, 30):
        q = q + dt * last.dq_rad_s
        last = limit(PARAMS, bodies, robot.at(q), command(robot, dt * k, neck_yaw=5.0 * (-1) ** k), last)
        rates.append(last.dq_rad_s[yaw])
        assert not excess(robot, q + HOLD_S * last.dq_rad_s).any()
    assert np.abs(np.diff(rates)).max() <= 10 * np.deg2rad(60) * dt + 1e-9


def test_a_command_that_has_ended_is_not_braked_from(robot, bodies):
    """While it lasts, rates change by at most 10 times 60°/s a second; a short one is no faster than can be stopped."""
    last = command(robot, neck_yaw=1.0)
    per_s = 10 * np.deg2rad(60)
    for wanted, expected in (
        (command(robot), {"neck_yaw": 1.0}),
        (command(robot, 0.05), {"neck_yaw": 1.0 - 0.05 * per_s}),
        (command(robot, 0.4), {}),
        (command(robot, 0.5), {}),
        (command(robot, 3.0, neck_yaw=5.0, neck_roll=0.5), {"neck_yaw": 60 * DEG, "neck_roll": 6 * DEG}),
        (command(robot, 3.0, hold_s=0.05, neck_yaw=5.0), {"neck_yaw": 0.05 * per_s}),
    ):
        held = limit(PARAMS, bodies, robot.at(home(robot)), wanted, last)
        np.testing.assert_allclose(held.dq_rad_s, command(robot, **expected).dq_rad_s, atol=1e-12)


def towards_the_chest(robot: Robot, q: Array) -> Array:
    """Rates of the left arm that take the forearm inwards at 10 cm/s."""
    point = MovingPoint("left_forearm", (0, -0.07, 0), (0.05, 0.1, 0))
    constraints = arm_constraints(ArmParams(), robot.at(q), "left", HOME_ARM_RAD)
    return arm_velocity(ArmParams(), robot.at(q), constraints, [point])


def test_an_arm_pressed_against_the_chest_stops_20_mm_before_it(robot, bodies):
    q = home(robot)
    free = home(robot)
    last = None
    distances = []
    for k in range(80):
        last = limit(PARAMS, bodies, robot.at(q), JointVelocity(DT * k, towards_the_chest(robot, q), HOLD_S), last)
        assert smallest_distance(bodies, q, last) >= 0.02 - 2e-6
        q = q + DT * last.dq_rad_s
        free = free + DT * towards_the_chest(robot, free)
        distances.append((bodies.distance_m(q), bodies.distance_m(free)))
    pressed, unchecked = np.array(distances).min(axis=0)
    assert unchecked < 0.015
    assert pressed < 0.022


def test_before_the_chest_the_arm_brakes_within_its_acceleration_limit(robot, rng, bodies):
    """Commands that change at random: the next one is not proven free, the way of the last one is."""
    arm = robot.indices(robot.names.arm("left"))
    dt = 0.01
    q = near_the_chest(robot, bodies, 0.03)
    last = command(robot)
    for k in range(200):
        dq = rng.uniform(-1, 3) * towards_the_chest(robot, q)
        dq[arm] += 0.5 * rng.standard_normal(7)
        previous = last
        last = limit(PARAMS, bodies, robot.at(q), JointVelocity(dt * k, dq, HOLD_S), last)
        assert np.abs(last.dq_rad_s - previous.dq_rad_s).max() <= 10 * np.deg2rad(60) * dt + 1e-9
        q = q + dt * last.dq_rad_s


def near_the_chest(robot: Robot, bodies: SelfCollision, distance_m: float) -> Array:
    q = home(robot)
    while bodies.distance_m(q) > distance_m:
        q = q + 0.01 * towards_the_chest(robot, q)
    return q


def test_an_arm_that_stands_as_predicted_brakes_without_another_proof(robot):
    """Nothing can be proven free; the way of the last command was."""

    class Doubtful(SelfCollision):
        def clear_share(self, q_rad: Array, change_rad: Array, clearance_m: float) -> float:
            return 0.0

    q = home(robot)
    last = command(robot, left_elbow=0.4, neck_yaw=0.3)
    posture = robot.at(q + 0.01 * last.dq_rad_s)
    yaw = 0.3 - 0.01 * 10 * np.deg2rad(60)
    for last_q, elbow in ((q, 0.98 * 0.4), (q + 1e-6, 0.0), (None, 0.0)):
        held = limit(PARAMS, Doubtful(robot), posture, command(robot, 0.01), last, last_q)
        np.testing.assert_allclose(held.dq_rad_s, command(robot, left_elbow=elbow, neck_yaw=yaw).dq_rad_s, atol=1e-12)


@pytest.mark.parametrize("start_m", [-0.01, -0.001, 0.0, 0.015])
def test_bodies_that_overlap_or_are_too_near_may_only_part(robot, bodies, start_m):
    """Asked by turns to come nearer and to part, the arm leaves the chest, and never goes back."""
    q = near_the_chest(robot, bodies, start_m)
    last = None
    previous = -1.0
    for k in range(100):
        wanted = JointVelocity(DT * k, (1.0 if k % 3 == 0 else -1.0) * towards_the_chest(robot, q), HOLD_S)
        last = limit(PARAMS, bodies, robot.at(q), wanted, last)
        distance = bodies.distance_m(q)
        assert distance >= min(previous, 0.02) - 2e-6
        assert smallest_distance(bodies, q, last) >= min(distance, 0.02) - 2e-6
        previous = distance
        q = q + DT * last.dq_rad_s
        if distance >= 0.02:
            return
    pytest.fail("still too near")


def test_an_arm_that_was_pushed_towards_the_chest_stops_at_once(robot, bodies):
    """The way of the last command is no longer free, so the distance goes before the acceleration limit."""
    q = near_the_chest(robot, bodies, 0.0205)
    last = JointVelocity(0.0, towards_the_chest(robot, q), HOLD_S)
    held = limit(PARAMS, bodies, robot.at(q), JointVelocity(0.001, last.dq_rad_s, HOLD_S), last)
    assert smallest_distance(bodies, q, held) >= 0.02 - 2e-6
    assert np.abs(held.dq_rad_s).max() < 0.1 * np.abs(last.dq_rad_s).max()


def test_limits_hold_from_the_reported_and_from_the_predicted_posture(robot, rng, bodies):
    """Joints and distance, for commands and for braking."""
    stopped = 0
    near, apart = (near_the_chest(robot, bodies, distance_m) for distance_m in (0.03, 0.05))
    (neck,) = robot.indices(("neck_yaw",))
    for _ in range(60):
        q, predicted = near.copy(), apart.copy()
        q[neck] = robot.upper_rad[neck] - 0.2
        predicted[neck] = robot.upper_rad[neck] - rng.uniform(0.0, 0.1)
        if rng.random() < 0.5:
            q, predicted = predicted, q
        last = JointVelocity(0.0, 0.2 * rng.random() * towards_the_chest(robot, q), HOLD_S)
        last_q = predicted - 0.05 * last.dq_rad_s
        dq = rng.uniform(0, 3) * towards_the_chest(robot, q) + command(robot, neck_yaw=rng.uniform(-0.5, 0.5)).dq_rad_s
        held = limit(PARAMS, bodies, robot.at(q), JointVelocity(0.05, dq, HOLD_S), last, last_q)
        for start in (q, predicted):
            assert not excess(robot, start + HOLD_S * held.dq_rad_s).any()
            assert smallest_distance(bodies, start, held) >= 0.02 - 2e-6
        alone = limit(PARAMS, bodies, robot.at(q), JointVelocity(0.05, dq, HOLD_S), last)
        stopped += np.abs(held.dq_rad_s).max() < np.abs(alone.dq_rad_s).max() - 1e-6
    assert 5 < stopped < 55
