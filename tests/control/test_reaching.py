"""An arm that reaches touches the object with the part that the object comes to, and with no other."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from tracks import track_at

from control.arm import MovingPoint
from control.avoidance import ArmInput, ArmState, Response
from control.limits import MAX_HOLD_S, LimitParams, limit
from control.reaching import ReachingParams, other_parts, step, target_taxel
from pps_vision.errors import InputError
from pps_vision.robot.icub import HOME_ARM_RAD, home
from pps_vision.robot.model import Robot
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import TOUCH_RADIUS_M, Skin, icub_skin
from pps_vision.types import Array, Track3D

DT = 0.05
BALL_M = 0.035
SKIN = icub_skin(("left_forearm", "left_palm"))
PARAMS = ReachingParams(HOME_ARM_RAD)
AT_ONCE = replace(PARAMS, confirmation_s=0.0)


def felt_by(*taxels: str, probability: float = 0.9) -> Array:
    a = np.zeros(len(SKIN.taxel_ids))
    a[[SKIN.index(taxel) for taxel in taxels]] = probability
    return a


def ball(position: Array, velocity: Array | Sequence[float] = (0.0, 0.0, 0.0), stamp_s: float = 0.0) -> Track3D:
    return track_at(position, velocity, stamp_s, radius_m=BALL_M)


def reach(
    robot: Robot,
    inputs: Iterable[tuple[Track3D, Array]],
    params: ReachingParams = PARAMS,
    skin: Skin = SKIN,
    q: Array | None = None,
    bodies: SelfCollision | None = None,
) -> Iterator[tuple[Array, Response]]:
    """Let an arm reach for tracks with activations at 20 Hz, through the last stage if there are bodies; yields the
    postures that it moves to and the responses."""
    q = home(robot) if q is None else q
    state = ArmState()
    last = None
    last_q = None
    for i, (track, a) in enumerate(inputs):
        arm = ArmInput(i * DT, robot.at(q), skin, a, track, DT if bodies is None else MAX_HOLD_S, bodies)
        state, response = step(params, state, arm, is_reachable=lambda taxel: True)
        command = response.command
        if bodies is not None:
            command = last = limit(LimitParams(), bodies, robot.at(q), command, last, last_q)
        last_q = q
        q = q + DT * command.dq_rad_s
        yield q, response


def test_an_arm_that_may_not_reach_does_not_begin_and_gives_up_at_once(robot):
    """An activation before it was allowed does not count for the confirmation."""
    params = replace(PARAMS, confirmation_s=0.1)
    posture = robot.at(home(robot))
    state = ArmState()
    modes = []
    points, normals = SKIN.at(posture)
    track = ball(points[0] + 0.1 * normals[0], -0.05 * normals[0])
    for k, is_reachable in enumerate([False] * 4 + [True] * 4 + [False] + [True] * 3):
        arm = ArmInput(k * DT, posture, SKIN, felt_by("left_forearm:27"), track)
        state, response = step(params, state, arm, lambda taxel, may=is_reachable: may)
        modes.append(response.mode)
        assert response.mode == "reach" or not response.command.dq_rad_s.any()
    assert modes == ["idle"] * 6 + ["reach"] * 2 + ["return"] + ["idle"] * 2 + ["reach"]


@pytest.mark.parametrize(
    ("before", "elapsed_s", "is_known", "is_felt", "mode"),
    [
        ("reach", 2.9, True, False, "reach"),
        ("reach", 3.1, True, False, "return"),
        ("reach", 3.1, True, True, "reach"),  # the activation alone decides
        ("idle", 3.1, True, True, "reach"),
        ("reach", 0.1, False, False, "hold"),
    ],
)
def test_reaching_outlasts_the_activation_by_three_seconds_but_not_the_track(
    robot, before, elapsed_s, is_known, is_felt, mode
):
    point = MovingPoint("left_palm", np.zeros(3), np.zeros(3))
    state = ArmState(before, 100.0, points=(point,), target_taxel=0)
    posture = robot.at(home(robot))
    track = ball(SKIN.at(posture)[0][0] + 0.1) if is_known else Track3D.unknown(0.1)
    arm = ArmInput(100.0 + elapsed_s, posture, SKIN, felt_by("left_forearm:27") * is_felt, track)
    assert step(AT_ONCE, state, arm, is_reachable=lambda taxel: True)[1].mode == mode


def test_the_part_that_the_object_comes_to_touches_it_and_no_other(robot):
    """A ball comes to the forearm for 0.3 s and waits beside the palm, whose taxels are activated more."""
    points, normals = SKIN.at(robot.at(home(robot)))
    k = SKIN.index("left_forearm:3")
    at = points[k] + (BALL_M + TOUCH_RADIUS_M + 0.05) * normals[k]
    a = np.maximum(felt_by("left_forearm:3", probability=0.6), felt_by("left_palm:101"))
    inputs = [(ball(at, -0.1 * normals[k] * (i < 6)), a) for i in range(60)]
    gaps = np.array([np.linalg.norm(SKIN.at(robot.at(q))[0] - at, axis=1) for q, _ in reach(robot, inputs)])
    forearm, palm = (gaps[:, SKIN.part_index == part].min() - BALL_M - TOUCH_RADIUS_M for part in (0, 1))
    assert forearm < 0 < palm


def test_reaching_goes_on_to_an_object_that_waits_beside_the_normal(robot):
    """Activation lasts for 0.3 s, while the ball comes; it waits 5 cm from the skin, 40° from the normal."""
    points, normals = SKIN.at(robot.at(home(robot)))
    k = SKIN.index("left_forearm:27")
    out = np.cos(0.7) * normals[k] + np.sin(0.7) * np.cross(normals[k], [0.0, 0.0, 1.0])
    at = points[k] + (BALL_M + TOUCH_RADIUS_M + 0.05) * out / np.linalg.norm(out)
    inputs = [(ball(at, -0.1 * out * (i < 6)), felt_by("left_forearm:27") * (i < 6)) for i in range(60)]
    gaps = []
    for q, response in reach(robot, inputs):
        gaps.append(np.linalg.norm(SKIN.at(robot.at(q))[0] - at, axis=1).min() - BALL_M)
        assert np.linalg.norm(response.velocity_root) < 0.1 + 1e-9
    assert gaps[0] > TOUCH_RADIUS_M + 0.04
    assert -0.01 < min(gaps) < TOUCH_RADIUS_M  # it stops at the surface


@pytest.mark.parametrize("active", ["left_forearm:3", "left_palm:101"])
def test_the_target_is_the_taxel_that_the_path_passes_nearest(robot, active):
    """Whichever taxel is active; it changes only while one is."""
    posture = robot.at(home(robot))
    state = ArmState()
    points, normals = SKIN.at(posture)
    first = SKIN.index("left_forearm:3")
    second = SKIN.index("left_palm:101")
    for i, (k, a) in enumerate([(first, felt_by(active)), (second, felt_by()), (second, felt_by(active))]):
        track = ball(points[k] + 0.2 * normals[k], -0.05 * normals[k])
        state, response = step(
            AT_ONCE,
            replace(state, positions=()),
            ArmInput(i * DT, posture, SKIN, a, track),
            is_reachable=lambda taxel: True,
        )
        assert response.mode == "reach"
        assert state.target_taxel == (second if i == 2 else first)
        assert state.points[0].frame == ("left_palm" if i == 2 else "left_forearm")


def test_the_position_history_decides_which_taxel_an_object_comes_to(robot):
    """Not its velocity, which overshoots, unless there is only one position; extrapolated for ten seconds."""
    posture = robot.at(home(robot))
    points, normals = SKIN.at(posture)
    first = SKIN.index("left_forearm:3")
    second = SKIN.index("left_forearm:159")
    at = points[first] + 0.45 * normals[first]
    to_second = points[second] - at
    at_5_cm_s = at + 0.05 * 0.5 * normals[first]  # half a second earlier
    for velocity, positions, expected in (
        (0.2 * to_second, ((100.0, at_5_cm_s), (100.5, at)), first),
        (0.2 * to_second, ((100.5, at),), second),
        (-0.05 * normals[first], ((100.0, at - 0.1 * to_second), (100.5, at)), second),
    ):
        arm = ArmInput(100.5, posture, SKIN, felt_by(), ball(at, velocity))
        assert target_taxel(PARAMS, arm, ArmState(positions=positions)) == expected


def test_the_other_parts_nearest_taxels_keep_clear(robot):
    """The object's radius counts where it is known."""
    posture = robot.at(home(robot))
    k = SKIN.index("left_palm:99")
    point = SKIN.at(posture)[0][k]
    way = np.array([0.6, 0.0, 0.8])
    for radius_m in (BALL_M, np.nan):
        arm = ArmInput(0.0, posture, SKIN, felt_by(), track_at(point - 0.01 * way, radius_m=radius_m))
        (near,) = other_parts(arm, SKIN.index("left_forearm:27"))
        assert near.frame == "left_palm"
        np.testing.assert_allclose(near.point_root, point)
        np.testing.assert_allclose(near.normal, -way)
        assert near.distance_m == pytest.approx(0.01 - (BALL_M if np.isfinite(radius_m) else 0.0))


# Joints (degrees) of a robot whose right forearm is 3.6 cm from its chest, and where a ball ends that comes to it.
BESIDE_CHEST_DEG = (0, 6, -1, 0, 15, 0, 20, 0, 0, 0, -40, -7, 22, -35, 4, -4, -37, 9, -13, 58, -41, -1, 14)
BALL_ENDS = np.array([-0.157, 0.031, -0.046])
BALL_VELOCITY = np.array([-0.021, 0.181, 0.179])


@pytest.mark.parametrize(("damping_m", "touches"), [(ReachingParams.damping_m, True), (0.003, False)])
def test_an_arm_beside_the_chest_reaches_a_ball_while_it_waits(robot, damping_m, touches):
    """Through the last stage, 0.7 s of approach and 2 s of waiting; with little damping alone the arm is too slow."""
    skin = icub_skin(("right_forearm", "right_palm"))
    bodies = SelfCollision(robot)
    start = np.deg2rad(BESIDE_CHEST_DEG)
    home_rad = tuple(start[robot.indices(robot.names.arm("right"))])
    params = ReachingParams(home_rad, "right", damping_m=damping_m)
    coming = np.arange(54) < 14
    places = [BALL_ENDS - max(0.7 - i * DT, 0.0) * BALL_VELOCITY for i in range(54)]
    a = 0.9 * np.eye(len(skin.taxel_ids))[skin.index("right_forearm:159")]
    inputs = [(ball(places[i], BALL_VELOCITY * coming[i], i * DT), a * coming[i]) for i in range(54)]
    gaps = []
    for (q, _), at in zip(reach(robot, inputs, params, skin, start, bodies), places, strict=True):
        assert bodies.distance_m(q) > LimitParams().clearance_m
        gaps.append(np.linalg.norm(skin.at(robot.at(q))[0] - at, axis=1).min() - BALL_M)
    assert (min(gaps) < TOUCH_RADIUS_M) == touches


def test_a_damping_of_zero_is_refused():
    with pytest.raises(InputError, match="damping_m 0; expected a positive number"):
        replace(PARAMS, damping_m=0)
