"""R eq. 6 by hand, and a ball that never touches the arm (pure kinematics, 20 Hz)."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from control.arm import ArmParams, MovingPoint
from control.avoidance import (
    AvoidanceParams,
    AvoidanceState,
    Response,
    control_points,
    step,
)
from control.avoidance_params import Mode
from control.avoidance_response import _EASE_IN_S, kept_clear, return_home
from control.limits import MAX_HOLD_S, LimitParams, limit
from control.reaching import distances_ahead, first_to_touch, other_parts, taxel_to_touch
from pps_vision.robot.bare_links import BareLinks
from pps_vision.robot.icub import HOME_ARM_DEG, home
from pps_vision.robot.model import Robot
from pps_vision.robot.self_collision import SelfCollision
from pps_vision.robot.skin import TOUCH_RADIUS_M, Skin, SkinPart, icub_skin, touched_taxels
from pps_vision.types import Array, JointVelocity, Status, Track3D

DEG = np.pi / 180
DT = 0.05
BALL_M = 0.035
PARAMS = AvoidanceParams(tuple(np.deg2rad(HOME_ARM_DEG)))
AT_ONCE = AvoidanceParams(PARAMS.home_arm_rad, confirm_s=0.0)
FOREARM = icub_skin(("left_forearm",))


def activations_of(skin: Skin, **activations: float) -> Array:
    a = np.zeros(len(skin.taxel_ids))
    for name, value in activations.items():
        part, _, taxel = name.rpartition("_")
        a[skin.index(f"{part}:{taxel}")] = value
    return a


def run_arm(
    robot: Robot, activations: list[Array], params: AvoidanceParams = PARAMS
) -> Iterator[tuple[Array, Array, Response]]:
    """Runs the arm through a list of activations; yields (q before, command, response)."""
    q, state = home(robot), AvoidanceState()
    for k, a in enumerate(activations):
        state, command, response = step(params, state, robot.at(q), FOREARM, a, k * DT, may_reach=True)
        yield q, command.dq_rad_s, response
        q = q + DT * command.dq_rad_s
        assert np.all((q >= robot.lower_rad - 1e-8) & (q <= robot.upper_rad + 1e-8))


def test_p_and_n_are_activation_weighted_means_over_what_exceeds_the_threshold(robot: Robot) -> None:
    posture = robot.at(home(robot))
    positions, normals = FOREARM.at(posture)
    a = activations_of(
        FOREARM, left_forearm_27=0.5, left_forearm_135=1.0, left_forearm_15=0.4
    )  # 0.4 does not exceed 0.4
    ((frame, p, n, weight, likeliest),) = control_points(0.4, posture, FOREARM, a)
    assert (weight, likeliest) == (1.5, 1.0)
    i, j = FOREARM.index("left_forearm:27"), FOREARM.index("left_forearm:135")
    assert frame == "left_forearm"
    np.testing.assert_allclose(p, (positions[i] + 2 * positions[j]) / 3)
    mean = (normals[i] + 2 * normals[j]) / 3
    np.testing.assert_allclose(n, mean / np.linalg.norm(mean))


@pytest.mark.parametrize(
    ("forearm", "palms", "part"), [(0.9, (0.6, 0.6), "left_palm"), (0.9, (0.6, 0.0), "left_forearm")]
)
def test_the_most_active_body_part_has_the_control_point(
    robot: Robot, forearm: float, palms: tuple[float, float], part: str
) -> None:
    """By the sum of its activations."""
    skin = icub_skin(("left_forearm", "left_palm"))
    a = activations_of(skin, left_forearm_27=forearm, left_palm_101=palms[0], left_palm_99=palms[1])
    found = control_points(0.4, robot.at(home(robot)), skin, a)
    assert found[0].frame == part
    assert len(found) == 2


def test_an_arm_that_responds_follows_a_new_activation_at_once(robot: Robot) -> None:
    """Activation that pauses for a frame and moves on to another taxel needs no second confirmation."""
    first, second = activations_of(FOREARM, left_forearm_27=1.0), activations_of(FOREARM, left_forearm_87=1.0)
    *_, before, pause, after = run_arm(robot, [first] * 5 + [0 * first, second])
    assert before[2].mode == pause[2].mode == after[2].mode == "avoid"
    normal = FOREARM.at(robot.at(after[0]))[1][FOREARM.index("left_forearm:87")]
    np.testing.assert_allclose(after[2].velocity_root, -0.1 * normal, atol=1e-12)


def test_an_arm_without_skin_has_no_control_point(robot: Robot) -> None:
    assert control_points(0.4, robot.at(home(robot)), Skin(()), np.zeros(0)) == []


@pytest.mark.parametrize(("behaviour", "sign"), [("avoid", -1), ("reach", 1)])
def test_the_control_point_moves_10_cm_per_second_along_the_normal(robot: Robot, behaviour: str, sign: int) -> None:
    params = AvoidanceParams(PARAMS.home_arm_rad, behaviour=behaviour, withdraws="point", confirm_s=0.0)  # type: ignore[arg-type]
    i = FOREARM.index("left_forearm:27")
    ((q, dq, response),) = run_arm(robot, [activations_of(FOREARM, left_forearm_27=0.8)], params)
    (p, n), p_next = (array[i] for array in FOREARM.at(robot.at(q))), FOREARM.at(robot.at(q + 1e-4 * dq))[0][i]
    assert response.mode == behaviour
    np.testing.assert_allclose(response.velocity_root, sign * 0.1 * n)
    np.testing.assert_allclose(response.point_root, p)
    np.testing.assert_allclose((p_next - p) / 1e-4, sign * 0.1 * n, atol=0.005)


def test_without_activation_nothing_is_commanded(robot: Robot) -> None:
    for _, dq, response in run_arm(robot, [activations_of(FOREARM, left_forearm_27=0.4)] * 20):
        assert response.mode == "idle"
        assert not np.any(dq)
        assert not np.any(response.velocity_root)


def test_an_idle_arm_away_from_home_stays_there(robot: Robot) -> None:
    """Idle away from home: only an answer of its own ends in a return."""
    q = home(robot)
    q[robot.indices(("left_elbow",))] += 20 * DEG
    _, command, response = step(PARAMS, AvoidanceState(), robot.at(q), FOREARM, np.zeros(12), 0.0)
    assert response.mode == "idle"
    assert not np.any(command.dq_rad_s)


def test_a_joint_uses_the_room_that_the_holding_time_leaves(robot: Robot) -> None:
    """For some taxel the elbow is at its limit when the command ends, whether that is after 0.05 or 0.5 s."""
    q, (elbow,), params = home(robot), robot.indices(("left_elbow",)), replace(AT_ONCE, withdraws="point")
    q[elbow] = robot.upper_rad[elbow] - 0.02
    for hold_s in (0.05, 0.5):
        ends = []
        for a in np.eye(12):
            _, command, _ = step(params, AvoidanceState(), robot.at(q), FOREARM, a, 0.0, hold_s=hold_s)
            assert command.hold_s == hold_s
            ends.append(q[elbow] + hold_s * command.dq_rad_s[elbow])
        assert max(ends) == pytest.approx(robot.upper_rad[elbow], abs=1e-6)


def test_the_response_persists_then_the_arm_returns_smoothly_and_rests(robot: Robot) -> None:
    on = activations_of(FOREARM, left_forearm_27=1.0)
    run = list(run_arm(robot, [on] * 12 + [0 * on] * 120, AT_ONCE))
    modes = [response.mode for _, _, response in run]
    assert modes[:12] == ["avoid"] * 12
    n_persist = modes[12:].index("return")
    assert n_persist * DT == pytest.approx(0.3, abs=DT)
    assert modes[-1] == "idle"
    assert modes == sorted(modes, key=["avoid", "return", "idle"].index)  # each once, in this order
    palm = np.array([robot.at(q).point("left_palm") for q, _, _ in run])
    homeward = palm[12 + n_persist :]
    assert np.linalg.norm(np.diff(homeward, axis=0), axis=1).max() < 0.1 * DT * 1.05
    assert np.linalg.norm(np.diff(homeward, 2, axis=0), axis=1).max() < 0.1 * DT / 3  # no jump of speed
    eased = 0.1 * DT * np.arange(6) * DT / _EASE_IN_S  # from rest to full speed in six steps
    assert np.all(np.linalg.norm(np.diff(homeward, axis=0), axis=1)[:6] <= eased * 1.05 + 1e-9)
    assert np.linalg.norm(palm[-1] - palm[0]) < 0.003


def test_the_return_keeps_the_joints_rate_limit(robot: Robot) -> None:
    """Forearm and wrist far from home move the palm little, so its speed limit does not slow them."""
    q = home(robot)
    q[robot.indices(("left_wrist_prosupination", "left_wrist_pitch"))] += (80 * DEG, -50 * DEG)
    _, command, response = step(PARAMS, AvoidanceState("return"), robot.at(q), FOREARM, np.zeros(12), 1.0)
    assert response.mode == "return"
    assert np.abs(command.dq_rad_s).max() == pytest.approx(60 * DEG)


def test_activation_of_three_frames_is_not_confirmed(robot: Robot) -> None:
    on = activations_of(FOREARM, left_forearm_27=1.0)
    flicker = [on, on, on, 0 * on] * 5
    assert {response.mode for _, _, response in run_arm(robot, flicker)} == {"idle"}
    modes = [response.mode for _, _, response in run_arm(robot, [on] * 5)]
    assert modes == ["idle", "idle", "idle", "avoid", "avoid"]


def test_activation_during_the_return_is_responded_to(robot: Robot) -> None:
    on = activations_of(FOREARM, left_forearm_27=1.0)
    modes = [response.mode for _, _, response in run_arm(robot, [on] * 10 + [0 * on] * 12 + [on], AT_ONCE)]
    assert modes[-2:] == ["return", "avoid"]


@pytest.mark.parametrize("taxel", FOREARM.parts[0].ids)
@pytest.mark.parametrize("behaviour", ["avoid", "reach"])
def test_persistent_activation_moves_the_palm_no_further_than_its_sphere(
    robot: Robot, taxel: int, behaviour: str
) -> None:
    params = AvoidanceParams(PARAMS.home_arm_rad, behaviour=behaviour)  # type: ignore[arg-type]
    on = activations_of(FOREARM, **{f"left_forearm_{taxel}": 1.0})
    palm = [robot.at(q).point("left_palm") for q, _, _ in run_arm(robot, [on] * 80, params)]
    away = np.linalg.norm(np.array(palm) - palm[0], axis=1)
    assert 0.05 < away.max() < 0.203  # the sphere is kept by a weight, against joints at their limits


@pytest.mark.parametrize(
    "activations",
    [*(np.r_[np.zeros(11), bad] for bad in (np.nan, 1.1, -0.1)), np.full(12, np.nan), np.zeros(11), np.zeros((12, 1))],
)
def test_activations_that_are_not_one_number_a_taxel_are_refused(robot: Robot, activations: Array) -> None:
    with pytest.raises(ValueError, match=r"expected 12 numbers in \[0, 1\], one a taxel"):
        step(PARAMS, AvoidanceState(), robot.at(home(robot)), FOREARM, activations, 0.0)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"threshold": np.nan}, "a threshold of at most 1"),
        ({"threshold": 1.1}, "a threshold of at most 1"),
        ({"speed_m_s": -0.1}, "the rest above"),
        ({"confirm_s": -0.1}, "no time below 0"),
        ({"home_arm_rad": ()}, "expected an angle for each joint"),
        ({"home_arm_rad": (np.nan,) * 7}, "expected an angle for each joint"),
        ({"side": "Left"}, "'Left' arm; expected"),
        ({"behaviour": "flee"}, "'flee' by"),
        *(({name: -0.01}, "no time below 0") for name in ("persist_s", "come_m", "clear_m")),
        *(({name: 0.0}, "the rest above") for name in ("path_m", "speed_m_s", "radius_m", "reach_damping_m")),
    ],
)
def test_bad_parameters_are_refused(changes: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        replace(PARAMS, **changes)  # type: ignore[arg-type]


def test_what_may_be_nothing_or_as_much_as_can_be_is_accepted() -> None:
    most = replace(PARAMS, confirm_s=0.0, persist_s=0.0, come_m=0.0, clear_m=0.0, threshold=1.0, path_m=np.inf)
    assert replace(most, speed_m_s=0.01, radius_m=0.01, reach_damping_m=0.001).side == "left"


class Encounter:
    """A ball flies at a taxel's home position, ends at the first would-be contact and goes back.

    A taxel is excited when the ball in its cone is nearer than `lead_s` to contact; with
    `relative` the arm's own motion counts for that time, as on skin that moves.
    """

    def __init__(self, robot: Robot, skin: Skin, taxel: int, rng: np.random.Generator, speed_m_s: float) -> None:
        self.robot, self.skin, self.speed = robot, skin, speed_m_s
        positions, normals = skin.at(robot.at(home(robot)))
        self.aim, self.taxel = positions[taxel], taxel
        aside = np.cross(normals[taxel], rng.normal(size=3))
        cosine = rng.uniform(np.cos(45 * DEG), 1)
        self.way = cosine * normals[taxel] + np.sqrt(1 - cosine**2) * aside / np.linalg.norm(aside)
        before = (positions - self.aim) @ self.way  # where on the way each taxel is passed, and how far aside
        aside2 = np.sum((positions - self.aim) ** 2, axis=1) - before**2
        within = aside2 < (BALL_M + TOUCH_RADIUS_M) ** 2
        self.nearest = (before + np.sqrt(np.where(within, (BALL_M + TOUCH_RADIUS_M) ** 2 - aside2, 0)))[within].max()
        self.nearest -= 5e-4

    def ball(self, t: float) -> tuple[Array, Array]:
        """Center (3,) and velocity (3,)."""
        t_turn = (0.3 - self.nearest) / self.speed
        return (
            self.aim + (self.nearest + self.speed * abs(t - t_turn)) * self.way,
            (self.speed if t > t_turn else -self.speed) * self.way,
        )

    def activations(self, positions: Array, normals: Array, v_skin: Array, t: float, lead_s: float) -> Array:
        center, velocity = self.ball(t)
        d = center - positions
        distance = np.linalg.norm(d, axis=1)
        closing = np.maximum(-np.einsum("ni,ni->n", d, velocity - v_skin) / distance, 1e-9)
        near = (distance - BALL_M - TOUCH_RADIUS_M) / closing < lead_s
        in_cone = np.einsum("ni,ni->n", d, normals) / distance > np.cos(45 * DEG)
        in_cone[self.taxel] = True
        return np.where(near & in_cone, 1.0, 0.0)

    def touches(self, params: AvoidanceParams, lead_s: float, relative: bool = False) -> bool:
        q, state, v_skin = home(self.robot), AvoidanceState(), np.zeros((len(self.skin.taxel_ids), 3))
        for k in range(int(2 * (0.3 - self.nearest) / self.speed / DT)):
            posture = self.robot.at(q)
            positions, normals = self.skin.at(posture)
            a = self.activations(positions, normals, v_skin, k * DT, lead_s)
            state, command, _ = step(params, state, posture, self.skin, a, k * DT)
            for part in (0.25, 0.5, 0.75, 1.0):
                moved = self.skin.at(self.robot.at(q + part * DT * command.dq_rad_s))[0]
                if touched_taxels(moved, self.ball((k + part) * DT)[0], BALL_M).any():
                    return True
            v_skin = (moved - positions) / DT if relative else v_skin
            q = q + DT * command.dq_rad_s
        return False


@pytest.mark.parametrize("relative", [False, True], ids=["ball's speed", "relative speed"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_no_ball_touches_an_arm_with_avoidance(
    robot: Robot, rng: np.random.Generator, side: str, relative: bool
) -> None:
    skin = icub_skin((f"{side}_forearm",))  # type: ignore[arg-type]
    params = AvoidanceParams(PARAMS.home_arm_rad, side=side)  # type: ignore[arg-type]
    for taxel in range(12):
        encounter = Encounter(robot, skin, taxel, rng, rng.uniform(0.05, 0.15))
        assert not encounter.touches(params, lead_s=1.2, relative=relative)


def test_the_same_ball_touches_an_arm_without_activation(robot: Robot, rng: np.random.Generator) -> None:
    for taxel in range(12):
        assert Encounter(robot, FOREARM, taxel, rng, 0.1).touches(PARAMS, lead_s=-1.0)


def test_four_control_periods_of_warning_are_enough(robot: Robot, rng: np.random.Generator) -> None:
    """The time to contact that still saves the arm; with two one of twelve balls touches a taxel that slides across."""
    saved = {}
    for lead_s in (0.1, 0.2, 0.4):
        encounters = [Encounter(robot, FOREARM, taxel, rng, rng.uniform(0.05, 0.15)) for taxel in range(12)]
        saved[lead_s] = sum(not encounter.touches(PARAMS, lead_s) for encounter in encounters)
    assert saved[0.2] >= 11
    assert saved[0.4] == 12


def test_an_arm_that_may_not_reach_does_not_begin_and_gives_up_at_once(robot: Robot) -> None:
    """And it begins anew what it feels then: nothing is carried over from before it was allowed."""
    params = AvoidanceParams(PARAMS.home_arm_rad, behaviour="reach", confirm_s=0.1)
    posture, a = robot.at(home(robot)), activations_of(FOREARM, left_forearm_27=0.9)
    modes, state = [], AvoidanceState()
    for k, may in enumerate([None] * 4 + [True] * 4 + [None] + [True] * 3):
        given = {} if may is None else {"may_reach": may}
        state, command, response = step(params, state, posture, FOREARM, a, k * DT, **given)
        modes.append(response.mode)
        assert response.mode == "reach" or not command.dq_rad_s.any()
    assert modes == ["idle"] * 6 + ["reach"] * 2 + ["return"] + ["idle"] * 2 + ["reach"]


def test_by_count_the_speed_grows_with_the_activation(robot: Robot) -> None:
    """R eq. 6 as printed: N = Σ a n / k."""
    posture, (positions, normals) = robot.at(home(robot)), FOREARM.at(robot.at(home(robot)))
    i, j = FOREARM.index("left_forearm:27"), FOREARM.index("left_forearm:15")
    a = activations_of(FOREARM, left_forearm_27=0.5, left_forearm_15=0.9)
    ((_, p, n, *_),) = control_points(0.4, posture, FOREARM, a, "count")
    np.testing.assert_allclose(n, (0.5 * normals[i] + 0.9 * normals[j]) / 2)
    np.testing.assert_allclose(p, (0.5 * positions[i] + 0.9 * positions[j]) / 1.4)
    params = replace(AT_ONCE, weighting="count", withdraws="point")
    ((_, _, response),) = run_arm(robot, [a], params)
    np.testing.assert_allclose(response.velocity_root, -0.1 * n)


def test_all_parts_withdraw_at_once_and_the_likeliest_reaches(robot: Robot) -> None:
    """Two stimuli: one before the forearm, one before the palm; touching by the largest activation, not the sum."""
    skin = icub_skin(("left_forearm", "left_palm"))
    a = activations_of(skin, left_forearm_27=0.6, left_forearm_15=0.6, left_palm_101=0.9)
    posture = robot.at(home(robot))
    state, command, _ = step(AT_ONCE, AvoidanceState(), posture, skin, a, 0.0)
    moved = robot.at(home(robot) + 1e-4 * command.dq_rad_s)
    positions, normals = skin.at(posture)
    away = (skin.at(moved)[0] - positions) / 1e-4
    for name in ("left_forearm:27", "left_palm:101"):
        k = skin.index(name)
        assert away[k] @ normals[k] < -0.03
    assert {one.frame for one in state.points} == {"left_forearm", "left_palm"}
    reaching = replace(AT_ONCE, behaviour="reach")
    state, _, response = step(reaching, AvoidanceState(), posture, skin, a, 0.0, may_reach=True)
    assert [one.frame for one in state.points] == ["left_palm"]
    np.testing.assert_allclose(response.point_root, positions[skin.index("left_palm:101")])


def test_the_part_that_began_to_reach_touches_and_no_other(robot: Robot) -> None:
    """A ball comes to the forearm beside the palm, whose taxels are activated more: the forearm touches it."""
    skin = icub_skin(("left_forearm", "left_palm"))
    q, state = home(robot), AvoidanceState()
    points, normals = skin.at(robot.at(q))
    on_forearm, on_palm = skin.part_index == 0, skin.part_index == 1
    k = skin.index("left_forearm:3")
    at = points[k] + (BALL_M + TOUCH_RADIUS_M + 0.05) * normals[k]
    a = activations_of(skin, left_forearm_3=0.6, left_palm_101=0.9)
    params, least = AvoidanceParams(PARAMS.home_arm_rad, behaviour="reach", come_m=0.0), np.full(2, np.inf)
    for i in range(60):
        track = track_at(at, -0.1 * normals[k] * (i < 6))
        state, command, _ = step(params, state, robot.at(q), skin, a, i * DT, may_reach=True, hold_s=DT, track=track)
        q = q + DT * command.dq_rad_s
        gaps = np.linalg.norm(skin.at(robot.at(q))[0] - at, axis=1) - BALL_M - TOUCH_RADIUS_M
        least = np.minimum(least, [gaps[on_forearm].min(), gaps[on_palm].min()])
    assert least[0] < 0 < least[1]


@pytest.mark.parametrize("taxel", ["left_forearm:3", "left_palm:101"])
@pytest.mark.parametrize("active", ["left_forearm_3", "left_palm_101"])
def test_the_part_reaches_that_the_path_ends_at_whatever_is_active(robot: Robot, taxel: str, active: str) -> None:
    """A ball at 5 cm/s, 4 s from the taxel that it moves straight to."""
    skin = icub_skin(("left_forearm", "left_palm"))
    posture = robot.at(home(robot))
    points, normals = skin.at(posture)
    k = skin.index(taxel)
    params = replace(AT_ONCE, behaviour="reach", come_m=0.0)
    track = track_at(points[k] + 0.20 * normals[k], -0.05 * normals[k])
    state, _, _ = step(
        params, AvoidanceState(), posture, skin, activations_of(skin, **{active: 0.9}), 0.0, may_reach=True, track=track
    )
    assert state.mode == "reach"
    assert state.points[0].frame == taxel.partition(":")[0]


# Joints (degrees) of a robot whose right forearm is 3.6 cm from its chest, and where a ball ends that comes to it.
BESIDE_CHEST_DEG = (0, 6, -1, 0, 15, 0, 20, 0, 0, 0, -40, -7, 22, -35, 4, -4, -37, 9, -13, 58, -41, -1, 14)
BALL_ENDS, BALL_CAME = np.array([-0.157, 0.031, -0.046]), np.array([-0.021, 0.181, 0.179])


@pytest.mark.parametrize(("damping_m", "touches"), [(AvoidanceParams.reach_damping_m, True), (0.003, False)])
def test_an_arm_beside_the_chest_reaches_a_ball_while_it_waits(robot: Robot, damping_m: float, touches: bool) -> None:
    """Through the last stage, 0.7 s of approach and 2 s of waiting; with little damping alone the arm is too slow."""
    skin, bodies = icub_skin(("right_forearm", "right_palm")), SelfCollision(robot)
    q, state, last, last_q, gaps = np.deg2rad(BESIDE_CHEST_DEG), AvoidanceState(), None, None, []
    at_home = tuple(q[robot.indices(robot.names.arm("right"))])
    params = AvoidanceParams(at_home, "right", "reach", come_m=0.0, reach_damping_m=damping_m)
    for i in range(54):
        t, coming = i * DT, i < 14
        at = BALL_ENDS - max(0.7 - t, 0.0) * BALL_CAME
        a = activations_of(skin, right_forearm_159=0.9 * coming)
        seen = replace(track_at(at, BALL_CAME * coming), stamp_s=t)
        state, command, _ = step(
            params, state, robot.at(q), skin, a, t, may_reach=True, self_collision=bodies, track=seen
        )
        wanted = JointVelocity(t, command.dq_rad_s, MAX_HOLD_S)
        last, last_q = limit(LimitParams(), bodies, robot.at(q), wanted, last, last_q), q
        q = q + DT * last.dq_rad_s
        assert bodies.distance_m(q) > LimitParams().clearance_m
        gaps.append(np.linalg.norm(skin.at(robot.at(q))[0] - at, axis=1).min() - BALL_M)
    assert (min(gaps) < TOUCH_RADIUS_M) == touches


def always(dq: Array) -> Callable[[object], Array]:
    return lambda _: dq


def test_the_taxel_that_touches_first_at_the_speeds_allowed_is_chosen(robot: Robot, rng: np.random.Generator) -> None:
    """Gaps by the speeds at which they close, by finite differences; all taxels are moved by the same joint rates."""
    skin, q = icub_skin(("left_forearm", "left_palm")), home(robot)
    posture, aimed_at = robot.at(q), skin.index("left_forearm:3")
    positions, normals = skin.at(posture)
    side = [i for i in np.flatnonzero(skin.part_index == 0) if normals[i] @ normals[aimed_at] > 0]
    others = 0
    for _ in range(20):
        at = positions[aimed_at] + 0.1 * normals[aimed_at] + rng.uniform(-0.03, 0.03, 3)
        dq = np.zeros(robot.n_joints)
        dq[robot.indices(robot.names.arm("left"))] = rng.uniform(-0.3, 0.3, 7)
        gaps, later = (
            np.linalg.norm(skin.at(robot.at(q + s * dq))[0][side] - at, axis=1) - BALL_M - TOUCH_RADIUS_M
            for s in (0.0, 1e-6)
        )
        closing = (gaps - later) / 1e-6
        if closing.max() < 1e-3:
            continue
        best = side[int(np.where(closing > 0, gaps / closing, np.inf).argmin())]
        way = first_to_touch(0.1, aimed_at, posture, skin, track_at(at, np.zeros(3)), always(dq))
        np.testing.assert_allclose(posture.point(way.point.frame, way.point.point), positions[best], atol=1e-9)
        others += best != side[int(gaps.argmin())]
    assert others > 3


def track_at(position: Array, velocity: Array, radius_m: float = BALL_M, status: Status = Status.TRACKING) -> Track3D:
    mean = np.array([position, velocity, np.zeros(3), np.zeros(3)])
    return Track3D(0.0, mean, 1e-6 * np.eye(12), radius_m, 1e-8, status)


def test_nearest_points_of_links_without_taxels(robot: Robot) -> None:
    """By hand for the elbow's ball of 36 mm; the palm is bare only where its skin is missing."""
    posture, links = robot.at(home(robot)), BareLinks(robot, FOREARM, "left")
    elbow, up = posture.point("left_lower_arm"), np.array([0.0, 0.0, 1.0])
    near = {one.frame: one for one in links.near(posture, elbow + 0.1 * up, 0.02)}
    assert set(near) == {"left_upper_arm", "left_lower_arm", "left_palm"}
    np.testing.assert_allclose(near["left_lower_arm"].normal, [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(near["left_lower_arm"].point_root, elbow + 0.036 * up, atol=1e-6)
    assert near["left_lower_arm"].distance_m == pytest.approx(0.1 - 0.02 - 0.036, abs=1e-6)
    assert all(np.isinf(one.distance_m) for one in links.near(posture, elbow + 5 * up, 0.02))


@pytest.mark.parametrize("aside_m", [0.0, 0.12])
def test_the_elbow_which_has_no_taxels_gives_way_to_what_comes_and_not_to_what_passes(
    robot: Robot, aside_m: float
) -> None:
    links, q, state = BareLinks(robot, FOREARM, "left"), home(robot), AvoidanceState()
    way = np.array([0.0, -1.0, 0.0])  # the left side
    across = np.array([0.0, 0.0, -1.0])
    elbow, gaps, moved = robot.at(q).point("left_lower_arm"), [], False
    for k in range(120):
        center = elbow + aside_m * across + (0.25 - 0.1 * min(k * DT, 2.0)) * way
        gaps.append(min(one.distance_m for one in links.near(robot.at(q), center, BALL_M)))
        velocity = -0.1 * way if k * DT < 2.0 else 0 * way
        track = track_at(center, velocity)
        state, command, _ = step(
            PARAMS, state, robot.at(q), FOREARM, np.zeros(12), k * DT, hold_s=0.05, track=track, bare_links=links
        )
        moved = moved or bool(command.dq_rad_s.any())
        q = q + DT * command.dq_rad_s
    assert moved == (aside_m == 0.0)
    assert min(gaps) > (0.02 if aside_m == 0.0 else 0.05)


@pytest.mark.parametrize(
    ("aside_m", "path_m", "expected"), [(0.0, 0.05, True), (0.15, 0.05, False), (0.15, np.inf, True)]
)
def test_an_arm_at_rest_responds_to_what_comes_and_not_to_what_passes(
    robot: Robot, aside_m: float, path_m: float, expected: bool
) -> None:
    """A ball 20 cm from the skin flies along the normal, or past it at 15 cm; R responds to both."""
    posture, state, moved = robot.at(home(robot)), AvoidanceState(), False
    points, normals = FOREARM.at(posture)
    k = FOREARM.index("left_forearm:27")
    aside = np.cross(normals[k], points.mean(axis=0) - posture.point("left_palm"))
    aside *= np.sign((points[k] - points.mean(axis=0)) @ aside) / np.linalg.norm(aside)
    for i in range(6):
        track = track_at(points[k] + aside_m * aside + (0.2 - 0.1 * DT * i) * normals[k], -0.1 * normals[k])
        a = activations_of(FOREARM, left_forearm_27=0.9)
        params = replace(PARAMS, path_m=path_m)
        state, command, _ = step(params, state, posture, FOREARM, a, i * DT, track=track)
        moved = moved or bool(command.dq_rad_s.any())
    assert moved == expected


@pytest.mark.parametrize(
    ("come_m", "coming", "expected"), [(0.01, False, False), (0.01, True, True), (0.0, False, True)]
)
def test_an_arm_at_rest_responds_to_what_has_come_nearer(
    robot: Robot, come_m: float, coming: bool, expected: bool
) -> None:
    """A ball recedes by 5 cm and stops 12 cm from the skin, where its estimated velocity points back for 0.3 s; or it
    turns and comes, and is responded to once it has come by 1 cm, not 0.15 s later."""
    posture, state, modes = robot.at(home(robot)), AvoidanceState(), []
    points, normals = FOREARM.at(posture)
    k = FOREARM.index("left_forearm:27")
    a, params = activations_of(FOREARM, left_forearm_27=0.9), replace(PARAMS, come_m=come_m)
    for i in range(16):
        m = 0.12 + (-0.01 * (i - 10) if coming and i >= 10 else min(0.0, 0.01 * (i - 5)))
        track = track_at(points[k] + (BALL_M + m) * normals[k], (-0.2 if i >= 10 else 0.0) * normals[k])
        state, _, response = step(params, state, posture, FOREARM, a * (i >= 10), i * DT, track=track)
        modes.append(response.mode)
    assert ("avoid" in modes) == expected
    if coming:
        assert modes.index("avoid") in (11, 12)


@pytest.mark.parametrize(("speed_m_s", "expected"), [(0.018, False), (0.024, True)])
def test_an_object_has_come_that_is_nearer_by_a_centimetre_than_half_a_second_ago(
    robot: Robot, speed_m_s: float, expected: bool
) -> None:
    """By 9 or by 12 mm; its estimated velocity, of nothing, does not count."""
    posture, state, modes = robot.at(home(robot)), AvoidanceState(), set()
    points, normals = FOREARM.at(posture)
    k = FOREARM.index("left_forearm:27")
    a = activations_of(FOREARM, left_forearm_27=0.9)
    for i in range(20):
        at = points[k] + (BALL_M + 0.1 - speed_m_s * i * DT) * normals[k]
        state, _, response = step(PARAMS, state, posture, FOREARM, a, 100 + i * DT, track=track_at(at, np.zeros(3)))
        modes.add(response.mode)
    assert ("avoid" in modes) == expected


@pytest.mark.parametrize(("passes_m", "expected"), [(0.045, True), (0.055, False)])
def test_an_arm_at_rest_responds_to_what_comes_as_near_as_five_centimetres(
    robot: Robot, passes_m: float, expected: bool
) -> None:
    """A ball that passes one taxel so far from its surface, before the others."""
    posture, state, moved = robot.at(home(robot)), AvoidanceState(), False
    points, normals = FOREARM.at(posture)
    k = FOREARM.index("left_forearm:27")
    along = points - points.mean(axis=0)
    along = np.linalg.svd(along)[2][0]  # the forearm's axis, across which the ball flies
    across = np.cross(normals[k], along)
    across /= np.linalg.norm(across)
    line = points[k] + 0.2 * normals[k]
    lateral = np.linalg.norm(np.cross(line - points, across), axis=1).min()
    line -= (lateral - BALL_M - passes_m) * normals[k]
    while (gap := np.linalg.norm(np.cross(line - points, across), axis=1).min() - BALL_M) > passes_m + 1e-4:
        line -= (gap - passes_m) * normals[k]
    for i in range(6):
        track = track_at(line + (0.2 - 0.1 * DT * i) * across, -0.1 * across)
        a = activations_of(FOREARM, left_forearm_27=0.9)
        state, command, _ = step(PARAMS, state, posture, FOREARM, a, i * DT, track=track)
        moved = moved or bool(command.dq_rad_s.any())
    assert moved == expected


def test_normals_that_cancel_slow_the_response_down(robot: Robot) -> None:
    """A mean normal of half the length or more means full speed, a shorter one as much less."""
    skin = Skin((made_up_part([(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]),))
    posture = robot.at(np.zeros(robot.n_joints))
    for activations, expected in (((1.0, 0.8, 0.0), 0.2 / 1.8 / 0.5), ((0.9, 0.0, 0.9), 1.0), ((1.0, 1.0, 0.0), 0.0)):
        ((_, _, direction, *_),) = control_points(0.4, posture, skin, np.array(activations))
        assert np.linalg.norm(direction) == pytest.approx(expected, abs=1e-12)


def made_up_part(normals: list[tuple[float, float, float]]) -> SkinPart:
    n = len(normals)
    return SkinPart("made up", "left_forearm", tuple(range(n)), np.zeros((n, 3)), np.array(normals))


def test_the_way_home_takes_three_times_the_angle_left_per_second_after_easing_in(robot: Robot) -> None:
    """A degree from home, where no speed limit counts; at rest at first, at full speed after 0.3 s."""
    q, (elbow,) = home(robot), robot.indices(("left_elbow",))
    q[elbow] += 1 * DEG
    for elapsed_s, share in ((0.0, 0.0), (0.15, 0.5), (0.3, 1.0), (2.0, 1.0)):
        dq = return_home(PARAMS, robot.at(q), elapsed_s, (np.empty((0, robot.n_joints)), np.empty(0)))
        assert dq[elbow] == pytest.approx(-3 * DEG * share)
        assert not np.delete(dq, elbow).any()


def test_the_way_home_is_slowed_by_what_it_would_come_too_near_to_alone(robot: Robot) -> None:
    """Two links near the object: the arm goes towards one, for which half the speed is left, and away from another."""
    q, (elbow,) = home(robot), robot.indices(("left_elbow",))
    q[elbow] += 1 * DEG
    rows = np.zeros((2, robot.n_joints))
    rows[:, elbow] = -1.0, 1.0
    dq = return_home(PARAMS, robot.at(q), 1.0, (rows, np.array([1.5 * DEG, 0.0])))
    assert dq[elbow] == pytest.approx(-1.5 * DEG)


def test_links_keep_three_centimetres_from_the_object(robot: Robot) -> None:
    """Their distances by coal after a small motion, and the speeds that take them to 3 cm while a command is held."""
    links, posture = BareLinks(robot, FOREARM, "left"), robot.at(home(robot))
    center = posture.point("left_lower_arm") + np.array([0.0, -0.12, 0.02])
    near = links.near(posture, center, BALL_M)
    far = near[0]._replace(distance_m=np.inf)
    rows, most = kept_clear(posture, [*near, far], 0.2)
    assert len(rows) == len(most) == len(near)
    distances = np.array([one.distance_m for one in near])
    np.testing.assert_allclose(most, np.maximum(distances - 0.03, 0.0) / 0.2)
    dq = np.linspace(-1, 1, robot.n_joints)
    later = np.array([one.distance_m for one in links.near(robot.at(posture.q_rad + 1e-3 * dq), center, BALL_M)])
    np.testing.assert_allclose(rows @ dq, (distances - later) / 1e-3, atol=2e-3)
    beside = links.near(posture, posture.point("left_lower_arm") + np.array([0.0, -0.08, 0.0]), BALL_M)
    assert min(one.distance_m for one in beside) < 0.03
    assert kept_clear(posture, beside, 0.2)[1].min() == 0.0


def test_taxels_that_are_moving_aside_go_on_as_they_do(robot: Robot) -> None:
    """A direction that is as good as the best is kept from one step to the next."""
    posture, kept = robot.at(home(robot)), 0
    points, normals = FOREARM.at(posture)
    for k in range(12):
        track = track_at(points[k] + 0.15 * normals[k], -0.25 * normals[k])
        given = posture, FOREARM, np.eye(12)[k]
        state, _, _ = step(replace(AT_ONCE, come_m=0.0), AvoidanceState(), *given, 1.0, track=track)
        if state.aside is None:
            continue
        way = -normals[k]
        turned = np.cos(0.02) * state.aside + np.sin(0.02) * np.cross(way, state.aside)
        after, _, response = step(AT_ONCE, replace(state, aside=turned), *given, 1.05, track=track)
        np.testing.assert_array_equal(after.aside, turned)
        assert response.velocity_root @ turned == pytest.approx(0.1)
        idle, _, _ = step(replace(AT_ONCE, come_m=0.0), AvoidanceState(aside=turned), *given, 1.05, track=track)
        np.testing.assert_array_equal(idle.aside, state.aside)
        kept += 1
    assert kept >= 2


@pytest.mark.parametrize(("speed_m_s", "aside"), [(0.15, False), (0.2, True)])
def test_taxels_move_aside_where_withdrawal_leaves_less_than_five_centimetres(
    robot: Robot, speed_m_s: float, aside: bool
) -> None:
    """Of a ball 25 cm from the skin it is predicted to leave 5.5 to 6 cm, or 2 to 3 if it is faster."""
    points, normals = FOREARM.at(robot.at(home(robot)))
    track, a = track_at(points[1] + 0.25 * normals[1], -speed_m_s * normals[1]), np.eye(12)[1]
    given = AvoidanceState(), robot.at(home(robot)), FOREARM, a, 0.0
    for change, expected in (({"clear_m": 0.02}, False), ({}, aside), ({"clear_m": 0.06}, True)):
        state, _, _ = step(replace(AT_ONCE, come_m=0.0, **change), *given, track=track)
        assert (state.aside is not None) == expected


def test_the_taxel_aimed_at_changes_with_an_activation_alone(robot: Robot) -> None:
    """A ball on its way to one taxel turns to another while nothing is felt; felt again, it is followed."""
    posture, params = robot.at(home(robot)), replace(AT_ONCE, behaviour="reach", come_m=0.0)
    points, normals = FOREARM.at(posture)
    first, second = FOREARM.index("left_forearm:3"), FOREARM.index("left_forearm:159")
    state, on = AvoidanceState(), activations_of(FOREARM, left_forearm_3=0.9)
    for i, (k, a) in enumerate([(first, on), (second, 0 * on), (second, on)]):
        track = track_at(points[k] + 0.1 * normals[k], -0.1 * normals[k])
        state = replace(state, seen=())
        state, _, response = step(params, state, posture, FOREARM, a, i * DT, may_reach=True, track=track)
        assert response.mode == "reach"
        assert state.aimed_at == (second if i == 2 else first)


def test_one_point_of_a_part_reaches_straight_for_the_object(robot: Robot) -> None:
    """With R's control points, from the weighted mean of two taxels; slower before the surface, which it does not
    pass while the command is held."""
    posture, params = robot.at(home(robot)), replace(AT_ONCE, behaviour="reach", withdraws="point", come_m=0.0)
    points, normals = FOREARM.at(posture)
    i, j = FOREARM.index("left_forearm:27"), FOREARM.index("left_forearm:15")
    a = activations_of(FOREARM, left_forearm_27=0.5, left_forearm_15=1.0)
    mean = (points[i] + 2 * points[j]) / 3
    for gap_m, speed in ((0.1, 0.1), (0.02, 0.04), (-0.01, 0.0)):
        track = track_at(mean + (BALL_M + gap_m) * normals[i], -0.05 * normals[i])
        state, _, response = step(params, AvoidanceState(), posture, FOREARM, a, 0.0, may_reach=True, track=track)
        np.testing.assert_allclose(response.point_root, mean)
        np.testing.assert_allclose(response.velocity_root, speed * normals[i], atol=1e-9)
        assert state.aimed_at is None


def test_the_path_that_an_object_was_seen_on_decides_which_taxel_it_comes_to(robot: Robot) -> None:
    """Not its velocity, which overshoots, unless it was seen once; followed for ten seconds."""
    posture = robot.at(home(robot))
    points, normals = FOREARM.at(posture)
    first, second = FOREARM.index("left_forearm:3"), FOREARM.index("left_forearm:159")
    at = points[first] + 0.45 * normals[first]
    to_second = points[second] - at
    track = track_at(at, 0.2 * to_second)
    before = at + 0.05 * 0.5 * normals[first]  # half a second ago, at 5 cm/s
    assert taxel_to_touch(FOREARM, posture, track, [(100.0, before), (100.5, at)]) == first
    assert taxel_to_touch(FOREARM, posture, track, [(100.5, at)]) == second
    straight = track_at(at, -0.05 * normals[first])
    assert taxel_to_touch(FOREARM, posture, straight, [(100.0, at - 0.1 * to_second), (100.5, at)]) == second


def test_how_near_an_object_comes_by_hand() -> None:
    """It flies along x for two seconds, past one point, short of another, and away from a third."""
    points = np.array([[0.1, 0.03, 0.04], [0.5, 0.0, 0.0], [-0.1, 0.0, 0.0]])
    found = distances_ahead(points, np.zeros(3), np.array([0.2, 0.0, 0.0]), 2.0)
    np.testing.assert_allclose(found, [0.05, 0.1, 0.1])
    np.testing.assert_allclose(distances_ahead(points, np.zeros(3), np.zeros(3), 2.0), [np.sqrt(0.0125), 0.5, 0.1])


def test_the_other_parts_nearest_taxels_are_to_keep_clear(robot: Robot) -> None:
    """Of all but the part that is to touch; the object's radius counts where it is known."""
    skin, posture = icub_skin(("left_forearm", "left_palm")), robot.at(home(robot))
    points, _ = skin.at(posture)
    k = skin.index("left_palm:99")
    way = np.array([0.6, 0.0, 0.8])
    for radius_m in (BALL_M, np.nan):
        (near,) = other_parts(posture, skin, "left_forearm", track_at(points[k] - 0.01 * way, 0 * way, radius_m))
        assert near.frame == "left_palm"
        np.testing.assert_allclose(near.point_root, points[k])
        np.testing.assert_allclose(near.normal, -way)
        assert near.distance_m == pytest.approx(0.01 - (BALL_M if np.isfinite(radius_m) else 0.0))


def test_taxels_withdraw_along_their_normals_and_no_faster_in_all(robot: Robot) -> None:
    """Each of two active taxels withdraws along its own normal; sliding across counts for the 10 cm/s too."""
    posture, a = robot.at(home(robot)), activations_of(FOREARM, left_forearm_27=0.9, left_forearm_135=0.9)
    _, command, _ = step(AT_ONCE, AvoidanceState(), posture, FOREARM, a, 0.0)
    positions, normals = FOREARM.at(posture)
    velocity = (FOREARM.at(robot.at(posture.q_rad + 1e-4 * command.dq_rad_s))[0] - positions) / 1e-4
    active = np.flatnonzero(a)
    along = -np.einsum("ni,ni->n", velocity, normals)[active]
    assert along.min() > 0.07
    assert np.linalg.norm(velocity[active], axis=1).max() == pytest.approx(0.1, rel=1e-3)


def test_reaching_goes_on_to_an_object_that_waits_beside_the_normal(robot: Robot) -> None:
    """Activation lasts for 0.3 s, while the ball comes; it waits 5 cm from the skin, 40° from the normal."""
    q, state, gaps = home(robot), AvoidanceState(), []
    points, normals = FOREARM.at(robot.at(q))
    k = FOREARM.index("left_forearm:27")
    out = np.cos(40 * DEG) * normals[k] + np.sin(40 * DEG) * np.cross(normals[k], [0.0, 0.0, 1.0])
    at = points[k] + (BALL_M + TOUCH_RADIUS_M + 0.05) * out / np.linalg.norm(out)
    params = AvoidanceParams(PARAMS.home_arm_rad, behaviour="reach", come_m=0.0)
    for i in range(60):
        a = activations_of(FOREARM, left_forearm_27=0.9 * (i < 6))
        track = track_at(at, -0.1 * out * (i < 6))
        state, command, response = step(
            params, state, robot.at(q), FOREARM, a, i * DT, may_reach=True, hold_s=DT, track=track
        )
        q = q + DT * command.dq_rad_s
        gaps.append(np.linalg.norm(FOREARM.at(robot.at(q))[0] - at, axis=1).min() - BALL_M)
        assert np.linalg.norm(response.velocity_root) < 0.1 + 1e-9
    assert gaps[0] > TOUCH_RADIUS_M + 0.04
    assert min(gaps) < TOUCH_RADIUS_M
    assert min(gaps) > -0.01  # it stops at the surface


def test_lost_in_mid_avoidance_the_arm_holds_still_then_goes_home(robot: Robot) -> None:
    on, modes, state, q = activations_of(FOREARM, left_forearm_27=1.0), [], AvoidanceState(), home(robot)
    skin_point = FOREARM.at(robot.at(q))[0][0]
    for k in range(120):
        track = track_at(skin_point, np.zeros(3)) if k < 10 else Track3D.unknown(k * DT)
        state, command, response = step(
            replace(AT_ONCE, come_m=0.0), state, robot.at(q), FOREARM, on * (k < 10), k * DT, hold_s=0.05, track=track
        )
        assert response.mode != "hold" or not command.dq_rad_s.any()
        modes.append(response.mode)
        q = q + DT * command.dq_rad_s
    assert modes[:10] == ["avoid"] * 10
    assert DT * modes.count("hold") == pytest.approx(1.0, abs=2 * DT)
    assert modes == sorted(modes, key=["avoid", "hold", "return", "idle"].index)
    np.testing.assert_allclose(q, home(robot), atol=0.3 * DEG)


@pytest.mark.parametrize(("distance_m", "mode"), [(0.25, "idle"), (0.1, "avoid")])
def test_an_object_of_unknown_radius_counts_as_a_point(robot: Robot, distance_m: float, mode: str) -> None:
    """In half a second it is 20, or 5 cm from the middle of the elbow's ball of 36 mm; 3 cm are kept clear."""
    way = np.array([0.0, -1.0, 0.0])
    track = track_at(robot.at(home(robot)).point("left_lower_arm") + distance_m * way, -0.1 * way, np.nan)
    links = BareLinks(robot, FOREARM, "left")
    _, _, response = step(
        AT_ONCE, AvoidanceState(), robot.at(home(robot)), FOREARM, np.zeros(12), 0.0, track=track, bare_links=links
    )
    assert response.mode == mode


@pytest.mark.parametrize(
    ("gap_m", "speed_m_s", "mode"),
    [(0.078, 0.1, "avoid"), (0.082, 0.1, "idle"), (0.028, 0.012, "avoid"), (0.028, 0.008, "idle")],
)
def test_a_bare_link_responds_to_what_will_be_nearer_than_three_centimetres(
    robot: Robot, gap_m: float, speed_m_s: float, mode: str
) -> None:
    """In half a second, and by more than 5 mm nearer than now."""
    way, links = np.array([0.0, -1.0, 0.0]), BareLinks(robot, FOREARM, "left")
    posture = robot.at(home(robot))
    track = track_at(posture.point("left_lower_arm") + (0.036 + BALL_M + gap_m) * way, -speed_m_s * way)
    given = posture, FOREARM, np.zeros(12), 0.0
    assert step(AT_ONCE, AvoidanceState(), *given, track=track, bare_links=links)[2].mode == mode


def test_a_bare_link_responds_to_what_is_past_it_in_half_a_second(robot: Robot) -> None:
    """At 80 cm/s it is at the elbow in a quarter of a second, and 20 cm beyond in another."""
    way, links, posture = np.array([0.0, -1.0, 0.0]), BareLinks(robot, FOREARM, "left"), robot.at(home(robot))
    track = track_at(posture.point("left_lower_arm") + np.array([0.0, 0.0, -0.06]) + 0.2 * way, -0.8 * way)
    given = posture, FOREARM, np.zeros(12), 0.0
    assert step(AT_ONCE, AvoidanceState(), *given, track=track, bare_links=links)[2].mode == "avoid"


@pytest.mark.parametrize(("gap_m", "mode"), [(0.106, "avoid"), (0.114, "idle")])
def test_what_comes_within_three_seconds_counts(robot: Robot, gap_m: float, mode: str) -> None:
    """At 2 cm/s: 6 cm nearer, to 5 cm from a taxel or not."""
    posture, taxel = robot.at(home(robot)), FOREARM.index("left_forearm:27")
    points, normals = FOREARM.at(posture)
    track = track_at(points[taxel] + (BALL_M + gap_m) * normals[taxel], -0.02 * normals[taxel])
    given = posture, FOREARM, activations_of(FOREARM, left_forearm_27=0.9), 0.0
    assert step(replace(AT_ONCE, come_m=0.0), AvoidanceState(), *given, track=track)[2].mode == mode


@pytest.mark.parametrize(
    ("before", "behaviour", "elapsed_s", "off_deg", "mode"),
    [
        ("reach", "reach", 2.9, 20.0, "reach"),
        ("reach", "reach", 3.1, 20.0, "return"),
        ("return", "avoid", 5.9, 20.0, "return"),
        ("return", "avoid", 6.1, 20.0, "idle"),
        ("return", "avoid", 1.0, 0.25, "return"),
        ("return", "avoid", 1.0, 0.15, "idle"),
        ("return", "avoid", 1.0, -0.25, "return"),
    ],
)
def test_without_activation_the_arm_goes_home_in_time_and_rests_there(
    robot: Robot, before: Mode, behaviour: str, elapsed_s: float, off_deg: float, mode: Mode
) -> None:
    """It reaches on for 3 s, and returns for 6 s or until each joint is within 0.2° of home."""
    q = home(robot)
    q[robot.indices(("left_elbow",))] += off_deg * DEG
    points = (MovingPoint("left_forearm", np.zeros(3), np.zeros(3)),) if before == "reach" else ()
    state, params = AvoidanceState(before, 100.0, points=points), replace(PARAMS, behaviour=behaviour)  # type: ignore[arg-type]
    given = robot.at(q), FOREARM, np.zeros(12), 100.0 + elapsed_s
    assert step(params, state, *given, may_reach=True)[2].mode == mode


@pytest.mark.parametrize(("moved_m", "mode"), [(0.04, "hold"), (0.06, "return")])
def test_the_arm_waits_until_what_interrupted_its_return_has_moved_away(
    robot: Robot, moved_m: float, mode: str
) -> None:
    on, modes, state, q = activations_of(FOREARM, left_forearm_27=1.0), [], AvoidanceState(), home(robot)
    params = replace(AT_ONCE, path_m=np.inf, come_m=0.0)
    for k in range(45):
        track = track_at(np.array([-0.3, 0.0, 0.3 + (moved_m if k >= 40 else 0.0)]), np.zeros(3))
        a = on if k < 10 or k == 20 else 0 * on
        state, command, response = step(params, state, robot.at(q), FOREARM, a, k * DT, hold_s=0.05, track=track)
        modes.append(response.mode)
        q = q + DT * command.dq_rad_s
    assert modes[19:21] == ["return", "avoid"]
    assert modes[30:40] == ["hold"] * 10
    assert modes[40:] == [mode] * 5


@pytest.mark.parametrize("change", [{"weighting": "mean"}, {"withdraws": "hand"}])
def test_another_weighting_or_control_point_is_refused(change: dict[str, str]) -> None:
    with pytest.raises(ValueError, match="expected sum or count, taxels or point"):
        AvoidanceParams((0.0,) * 7, **change)  # type: ignore[arg-type]


@pytest.mark.parametrize(("shares", "chosen"), [((1.0, 1.0), 1), ((1.0, 0.5), 0), ((0.5, 1.0), 1)])
def test_an_arm_reaches_with_the_damping_that_touches_first(
    robot: Robot, shares: tuple[float, float], chosen: int
) -> None:
    """With one joint, a taxel at r from its axis, and dampings d of 3 cm and 3 mm: rates as 1/(r² + d²), slowed by the
    share that the last stage lets through."""
    changes = list[Array]()

    class Watched(SelfCollision):
        def clear_share(self, q_rad: Array, change_rad: Array, clearance_m: float) -> float:
            assert clearance_m == LimitParams().clearance_m
            changes.append(change_rad)
            return shares[len(changes) - 1]

    posture, skin, (pitch,) = robot.at(home(robot)), FOREARM.parts[0], robot.indices(("left_shoulder_pitch",))
    one = Skin((SkinPart("one", skin.frame, (0,), skin.positions_m[:1], skin.normals[:1]),))
    (at,), _ = one.at(posture)
    moves = posture.jacobian(skin.frame, skin.positions_m[0])[:3, pitch]
    track = track_at(at + 0.2 * moves / np.linalg.norm(moves), np.zeros(3))
    params = replace(AT_ONCE, behaviour="reach", come_m=0.0, path_m=np.inf, arm=ArmParams(resting=6))
    given = posture, one, np.ones(1), 0.0
    _, command, _ = step(
        params, AvoidanceState(), *given, may_reach=True, hold_s=0.4, self_collision=Watched(robot), track=track
    )
    rates = np.array(changes)[:, pitch] / 0.4
    r2 = moves @ moves
    np.testing.assert_allclose(rates, 0.1 * np.sqrt(r2) / (r2 + np.array([0.03, 0.003]) ** 2), rtol=1e-3)
    assert command.dq_rad_s[pitch] == pytest.approx(rates[chosen], rel=1e-6)


def test_an_arm_that_reaches_takes_no_point_that_is_farther_from_the_object(robot: Robot) -> None:
    """With R's control points, of two taxels that become active in turn."""
    posture, params = robot.at(home(robot)), replace(AT_ONCE, behaviour="reach", withdraws="point", come_m=0.0)
    points, normals = FOREARM.at(posture)
    first, second = FOREARM.index("left_forearm:3"), FOREARM.index("left_forearm:159")
    for near, expected in ((first, first), (second, second)):
        state = AvoidanceState()
        track = track_at(points[near] + 0.1 * normals[near], -0.05 * normals[near])
        for i, active in enumerate((first, second)):
            state, _, response = step(
                params, state, posture, FOREARM, np.eye(12)[active], i * DT, may_reach=True, track=track
            )
        np.testing.assert_allclose(response.point_root, points[expected])
