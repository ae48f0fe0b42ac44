"""R eq. 6 by hand, the response of an arm, and balls that never touch it (pure kinematics, 20 Hz)."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tracks import track_at

from control.avoidance import (
    ArmInput,
    ArmState,
    AvoidanceParams,
    Response,
    clearance_rows,
    control_point,
    predicted_distances,
    step,
)
from pps_vision.errors import InputError
from pps_vision.robot.bare_links import BareLinks
from pps_vision.robot.icub import HOME_ARM_RAD, home
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import TOUCH_RADIUS_M, Skin, icub_skin, touched_taxels
from pps_vision.types import Array, Track3D

DEG = np.pi / 180
DT = 0.05
BALL_M = 0.035
PARAMS = AvoidanceParams(HOME_ARM_RAD, confirmation_s=0.15)
AT_ONCE = replace(PARAMS, confirmation_s=0.0)
FOREARM = icub_skin(("left_forearm",))
BOTH_PARTS = icub_skin(("left_forearm", "left_palm"))
AT_REST = track_at((-0.5, 0.0, 0.3), radius_m=BALL_M)
ON = np.eye(12)[FOREARM.index("left_forearm:27")]
OFF = 0 * ON


def activations_of(skin: Skin, **activations: float) -> Array:
    a = np.zeros(len(skin.taxel_ids))
    for name, value in activations.items():
        part, _, taxel = name.rpartition("_")
        a[skin.index(f"{part}:{taxel}")] = value
    return a


def arm_input(robot: Robot, q: Array | None = None, activations: Array | None = None, **changes: Any) -> ArmInput:
    """A robot at home whose left forearm perceives nothing of an object at rest, with changes."""
    posture = robot.at(home(robot) if q is None else q)
    skin = changes.pop("skin", FOREARM)
    a = np.zeros(len(skin.taxel_ids)) if activations is None else activations
    arm = ArmInput(stamp_s=0.0, posture=posture, skin=skin, activations=a, track=AT_REST)
    return replace(arm, **changes)


def run_arm(
    robot: Robot, inputs: Iterable[dict[str, Any]], params: AvoidanceParams = PARAMS
) -> Iterator[tuple[Array, Array, Response]]:
    """Move the arm through inputs at 20 Hz, of which these change; yields q before the command, rates, response."""
    q = home(robot)
    state = ArmState()
    for k, changes in enumerate(inputs):
        state, response = step(params, state, arm_input(robot, q, stamp_s=k * DT, **changes))
        dq = response.command.dq_rad_s
        yield q, dq, response
        q = q + DT * dq
        assert np.all((q >= robot.lower_rad - 1e-8) & (q <= robot.upper_rad + 1e-8))


def activated(*activations: Array) -> list[dict[str, Any]]:
    return [{"activations": a} for a in activations]


def modes_of(robot: Robot, inputs: Iterable[dict[str, Any]], params: AvoidanceParams = PARAMS) -> list[str]:
    return [response.mode for _, _, response in run_arm(robot, inputs, params)]


def test_p_and_n_of_eq_6_by_hand(robot):
    """Over the taxels above the threshold; the part with the larger sum of activations carries P."""
    posture = robot.at(home(robot))
    positions, normals = BOTH_PARTS.at(posture)
    i, j, k = (BOTH_PARTS.index(name) for name in ("left_forearm:27", "left_palm:101", "left_palm:99"))
    a = activations_of(BOTH_PARTS, left_forearm_27=0.9, left_palm_101=0.5, left_palm_99=0.6, left_palm_109=0.4)
    point = control_point(0.4, posture, BOTH_PARTS, a)
    frame, p_frame, direction = point
    assert frame == "left_palm"
    p = posture.point(frame, p_frame)
    np.testing.assert_allclose(p, (0.9 * positions[i] + 0.5 * positions[j] + 0.6 * positions[k]) / 2.0)
    np.testing.assert_allclose(direction, (0.9 * normals[i] + 0.5 * normals[j] + 0.6 * normals[k]) / 3)
    assert control_point(0.9, posture, BOTH_PARTS, a) is None


def test_taxels_withdraw_along_their_normals_at_10_cm_per_second(robot):
    """One at full speed; of two each along its own normal, the faster one at full speed, sliding included."""
    positions, normals = FOREARM.at(robot.at(home(robot)))
    for names in (("left_forearm_27",), ("left_forearm_27", "left_forearm_135")):
        a = activations_of(FOREARM, **dict.fromkeys(names, 0.9))
        ((q, dq, response),) = run_arm(robot, activated(a), AT_ONCE)
        velocity = (FOREARM.at(robot.at(q + 1e-4 * dq))[0] - positions) / 1e-4
        active = np.flatnonzero(a)
        assert -np.einsum("ni,ni->n", velocity, normals)[active].min() > 0.07
        assert np.linalg.norm(velocity[active], axis=1).max() == pytest.approx(0.1, rel=1e-3)
        np.testing.assert_allclose(response.velocity_root, -0.1 * normals[active[0]], atol=1e-12)


def test_all_parts_withdraw_at_once(robot):
    a = activations_of(BOTH_PARTS, left_forearm_27=0.6, left_forearm_15=0.6, left_palm_101=0.9)
    state, response = step(AT_ONCE, ArmState(), arm_input(robot, activations=a, skin=BOTH_PARTS))
    assert [point.frame for point in state.points] == ["left_palm", "left_forearm", "left_forearm"]
    positions, normals = BOTH_PARTS.at(robot.at(home(robot)))
    moved = BOTH_PARTS.at(robot.at(home(robot) + 1e-4 * response.command.dq_rad_s))[0]
    for name in ("left_forearm:27", "left_palm:101"):
        k = BOTH_PARTS.index(name)
        assert (moved - positions)[k] @ normals[k] < -0.03e-4


def test_an_idle_arm_stays_where_it_is(robot):
    """Without activation above the threshold, also away from home: only a response ends in a return."""
    q = home(robot)
    q[robot.indices(("left_elbow",))] += 20 * DEG
    a = activations_of(FOREARM, left_forearm_27=0.4)
    _, response = step(AT_ONCE, ArmState(), arm_input(robot, q, a))
    assert response.mode == "idle"
    assert not np.any(response.command.dq_rad_s)
    assert not np.any(response.velocity_root)


def test_short_activation_is_not_confirmed_and_a_new_one_is_followed_at_once(robot):
    """Three frames are too short; during a response or a return, activation of any taxel is enough."""
    second_taxel = activations_of(FOREARM, left_forearm_87=1.0)
    assert set(modes_of(robot, activated(ON, ON, ON, OFF) * 5)) == {"idle"}
    assert modes_of(robot, activated(ON) * 5) == ["idle"] * 3 + ["avoid"] * 2
    *_, (q, _, response) = run_arm(robot, activated(*[ON] * 5, OFF, second_taxel))
    normal = FOREARM.at(robot.at(q))[1][FOREARM.index("left_forearm:87")]
    np.testing.assert_allclose(response.velocity_root, -0.1 * normal, atol=1e-12)
    returning = modes_of(robot, activated(*[ON] * 10, *[OFF] * 12, *[ON] * 4))
    assert returning[21:] == ["return"] * 4 + ["avoid"]


def test_the_response_persists_then_the_arm_returns_smoothly_and_rests(robot):
    run = list(run_arm(robot, activated(*[ON] * 12, *[OFF] * 120), AT_ONCE))
    modes = [response.mode for _, _, response in run]
    assert modes[:12] == ["avoid"] * 12
    n_persist = modes[12:].index("return")
    assert n_persist * DT == pytest.approx(0.3, abs=DT)
    assert modes[-1] == "idle"
    assert modes == sorted(modes, key=["avoid", "return", "idle"].index)  # each once, in this order
    palm = np.array([robot.at(q).point("left_palm") for q, _, _ in run])
    homeward = palm[12 + n_persist :]
    speeds = np.linalg.norm(np.diff(homeward, axis=0), axis=1) / DT
    assert speeds.max() < 0.105
    assert np.linalg.norm(np.diff(homeward, 2, axis=0), axis=1).max() < 0.1 * DT / 3  # no jump of speed
    assert np.all(speeds[:6] <= 0.105 * np.arange(6) / 6 + 1e-9)  # full speed after 0.3 s
    assert np.linalg.norm(palm[-1] - palm[0]) < 0.003


@pytest.mark.parametrize(
    ("elapsed_s", "off_deg", "mode"),
    [(5.9, 20.0, "return"), (6.1, 20.0, "idle"), (1.0, -0.25, "return"), (1.0, 0.25, "return"), (1.0, 0.15, "idle")],
)
def test_the_return_ends_at_home_or_after_six_seconds(robot, elapsed_s, off_deg, mode):
    """Each joint within 0.2° of home."""
    q = home(robot)
    q[robot.indices(("left_elbow",))] += off_deg * DEG
    _, response = step(PARAMS, ArmState("return", 100.0), arm_input(robot, q, stamp_s=100.0 + elapsed_s))
    assert response.mode == mode


def test_a_joint_stops_on_paths_limit_within_the_holding_time(robot):
    """The elbow, 2 mrad from its limit, may turn faster if the command is held for a shorter time."""
    q = home(robot)
    (elbow,) = robot.indices(("left_elbow",))
    q[elbow] = robot.upper_rad[elbow] - 0.002
    fastest = {}
    for hold_s in (0.05, 0.5):
        commands = [step(AT_ONCE, ArmState(), arm_input(robot, q, a, hold_s=hold_s))[1].command for a in np.eye(12)]
        assert {command.hold_s for command in commands} == {hold_s}
        fastest[hold_s] = max(command.dq_rad_s[elbow] for command in commands)
        assert hold_s * fastest[hold_s] < 0.002 + 1e-6
    assert fastest[0.05] > 0.002 / 0.5


def test_persistent_activation_moves_the_palm_no_further_than_its_sphere(robot):
    for a in np.eye(12)[::3]:
        palm = [robot.at(q).point("left_palm") for q, _, _ in run_arm(robot, activated(a) * 80)]
        away = np.linalg.norm(np.array(palm) - palm[0], axis=1)
        assert 0.05 < away.max() < 0.203  # the sphere is a weighted constraint against joints at their limits


@pytest.mark.parametrize(
    "activations", [*(np.r_[np.zeros(11), bad] for bad in (np.nan, 1.1, -0.1)), np.zeros(11), np.zeros((12, 1))]
)
def test_activations_that_are_not_one_number_a_taxel_are_refused(robot, activations):
    with pytest.raises(InputError, match=r"expected 12 numbers in \[0, 1\], one a taxel"):
        step(PARAMS, ArmState(), arm_input(robot, activations=activations))


@pytest.mark.parametrize(
    "change",
    [
        {"threshold": np.nan},
        {"threshold": 1.1},
        {"home_arm_rad": ()},
        {"home_arm_rad": (np.nan,) * 7},
        {"side": "Left"},
        *({name: -0.01} for name in ("confirmation_s", "persist_s", "escape_clearance_m")),
        *({name: 0.0} for name in ("threshold", "speed_m_s", "radius_m")),
    ],
)
def test_bad_parameters_are_refused(change):
    with pytest.raises(InputError, match="expected"):
        replace(PARAMS, **change)


class Ball:
    """A ball that flies at a taxel's place at home, within 45° of its normal, from 30 cm away: straight on, or back
    from the first contact with skin at rest."""

    def __init__(
        self, robot: Robot, skin: Skin, taxel: int, rng: np.random.Generator, speed_m_s: float, turns: bool
    ) -> None:
        self.robot = robot
        self.skin = skin
        self.speed_m_s = speed_m_s
        positions, normals = skin.at(robot.at(home(robot)))
        aside = np.cross(normals[taxel], rng.normal(size=3))
        angle = rng.uniform(0, np.pi / 4)
        self.way = -np.cos(angle) * normals[taxel] - np.sin(angle) * aside / np.linalg.norm(aside)
        self.aim = positions[taxel]
        along = (positions - self.aim) @ self.way  # where on the way each taxel is passed, and how far aside
        aside2 = np.sum((positions - self.aim) ** 2, axis=1) - along**2
        within = aside2 < (BALL_M + TOUCH_RADIUS_M) ** 2
        contact = (along[within] - np.sqrt((BALL_M + TOUCH_RADIUS_M) ** 2 - aside2[within])).min()
        self.turn_s = (0.3 + contact + 0.002) / speed_m_s if turns else np.inf
        self.n_steps = int((2 * self.turn_s if turns else 0.45 / speed_m_s) / DT)

    def at(self, t: float) -> tuple[Array, Array]:
        """Center (3,) and velocity (3,)."""
        way_m = self.speed_m_s * (t if t < self.turn_s else 2 * self.turn_s - t) - 0.3
        return self.aim + way_m * self.way, np.sign(self.turn_s - t) * self.speed_m_s * self.way

    def activations(self, taxels: Array, normals: Array, t: float, lead_s: float) -> Array:
        """1 for the taxels that the ball comes to within `lead_s`."""
        center, velocity = self.at(t)
        way = velocity / self.speed_m_s
        d = center - taxels
        ahead = d @ -way
        near = (
            (ahead > 0)
            & (ahead - BALL_M - TOUCH_RADIUS_M < lead_s * self.speed_m_s)
            & (np.sum(d * normals, axis=1) > 0)
        )
        return near * (np.linalg.norm(d + ahead[:, None] * way, axis=1) < BALL_M + TOUCH_RADIUS_M).astype(float)

    def touches(self, params: AvoidanceParams, lead_s: float = 1.0) -> bool:
        """Whether it touches the arm; the ball and the robot's kinematics alone decide."""
        q = home(self.robot)
        state = ArmState()
        for k in range(self.n_steps):
            t = k * DT
            a = self.activations(*self.skin.at(self.robot.at(q)), t, lead_s)
            track = track_at(*self.at(t), t, radius_m=BALL_M)
            arm = arm_input(self.robot, q, a, skin=self.skin, stamp_s=t, hold_s=DT, track=track)
            state, response = step(params, state, arm)
            for share in (0.25, 0.5, 0.75, 1.0):
                moved = self.skin.at(self.robot.at(q + share * DT * response.command.dq_rad_s))[0]
                if touched_taxels(moved, self.at(t + share * DT)[0], BALL_M).any():
                    return True
            q = q + DT * response.command.dq_rad_s
        return False


@pytest.mark.parametrize("side", ["left", "right"])
def test_no_ball_that_turns_back_touches_an_arm_with_avoidance(robot, rng, side):
    """Every ball touches an arm without activation; 1.2 s of warning are enough, and mostly 0.2 s."""
    skin = icub_skin((f"{side}_forearm",))
    params = replace(PARAMS, side=side)
    balls = [Ball(robot, skin, taxel, rng, rng.uniform(0.05, 0.15), turns=True) for taxel in range(0, 12, 2)]
    touching = {lead_s: sum(ball.touches(params, lead_s) for ball in balls) for lead_s in (-1.0, 0.2, 1.2)}
    assert touching[-1.0] == 6
    assert touching[0.2] <= 1
    assert touching[1.2] == 0


def test_lost_in_mid_avoidance_the_arm_holds_still_then_goes_home(robot):
    tracks = [AT_REST if k < 10 else Track3D.unknown(k * DT) for k in range(120)]
    inputs = [{"activations": ON * (k < 10), "hold_s": DT, "track": track} for k, track in enumerate(tracks)]
    run = list(run_arm(robot, inputs, AT_ONCE))
    modes = [response.mode for _, _, response in run]
    assert not any(dq.any() for _, dq, response in run if response.mode == "hold")
    assert modes[:10] == ["avoid"] * 10
    assert DT * modes.count("hold") == pytest.approx(1.0, abs=2 * DT)
    assert modes == sorted(modes, key=["avoid", "hold", "return", "idle"].index)
    np.testing.assert_allclose(run[-1][0], home(robot), atol=0.3 * DEG)


@pytest.mark.parametrize(("moved_m", "mode"), [(0.04, "hold"), (0.06, "return")])
def test_the_arm_waits_until_what_interrupted_its_return_has_moved_away(robot, moved_m, mode):
    tracks = [track_at((-0.5, 0.0, 0.3 + (moved_m if k >= 40 else 0.0))) for k in range(45)]
    active = [ON if k < 10 or k == 20 else OFF for k in range(45)]
    inputs = [{"activations": a, "hold_s": DT, "track": track} for a, track in zip(active, tracks, strict=True)]
    modes = modes_of(robot, inputs, AT_ONCE)
    assert modes[19:21] == ["return", "avoid"]
    assert modes[30:] == ["hold"] * 10 + [mode] * 5


@pytest.mark.parametrize("aside_m", [0.0, 0.12])
def test_the_elbow_which_has_no_taxels_gives_way_to_what_comes_and_not_to_what_passes(robot, aside_m):
    links = BareLinks(robot, FOREARM, "left")
    way = np.array([0.0, -1.0, 0.0])
    start = robot.at(home(robot)).point("left_lower_arm") - np.array([0.0, 0.0, aside_m])
    centers = [start + (0.25 - 0.1 * min(k * DT, 2.0)) * way for k in range(120)]
    tracks = [track_at(p, -0.1 * way * (k < 40), radius_m=BALL_M) for k, p in enumerate(centers)]
    run = list(run_arm(robot, [{"hold_s": DT, "track": t, "bare_links": links} for t in tracks], PARAMS))
    gaps = [
        min(link.distance_m for link in links.nearest_points(robot.at(q), center, BALL_M))
        for (q, _, _), center in zip(run, centers, strict=True)
    ]
    assert any(dq.any() for _, dq, _ in run) == (aside_m == 0.0)
    assert min(gaps) > (0.02 if aside_m == 0.0 else 0.05)


@pytest.mark.parametrize(
    ("gap_m", "speed_m_s", "radius_m", "mode"),
    [
        (0.078, 0.1, BALL_M, "avoid"),
        (0.082, 0.1, BALL_M, "idle"),
        (0.028, 0.012, BALL_M, "avoid"),
        (0.028, 0.008, BALL_M, "idle"),
        (0.078, 0.1, np.nan, "idle"),
        (0.043, 0.1, np.nan, "avoid"),
        (0.129, 0.8, BALL_M, "avoid"),
    ],
)
def test_a_bare_link_responds_to_what_will_be_nearer_than_three_centimetres(robot, gap_m, speed_m_s, radius_m, mode):
    """Within half a second, by more than 5 mm nearer than now, also where it is past the link by then; an object of
    unknown radius counts as a point."""
    way = np.array([0.0, -1.0, 0.0])
    at = robot.at(home(robot)).point("left_lower_arm") + (0.036 + BALL_M + gap_m) * way
    track = track_at(at, -speed_m_s * way, radius_m=radius_m)
    arm = arm_input(robot, track=track, bare_links=BareLinks(robot, FOREARM, "left"))
    assert step(AT_ONCE, ArmState(), arm)[1].mode == mode


def test_links_keep_three_centimetres_from_the_object(robot):
    """Their distances by coal after a small motion, and the speeds that take them to 3 cm while a command is held."""
    links = BareLinks(robot, FOREARM, "left")
    arm = arm_input(robot, hold_s=0.2)
    posture = arm.posture
    elbow = posture.point("left_lower_arm")
    center = elbow + np.array([0.0, -0.12, 0.02])
    near = links.nearest_points(posture, center, BALL_M)
    rows, largest = clearance_rows(arm, [*near, near[0]._replace(distance_m=np.inf)])
    distances = np.array([link.distance_m for link in near])
    np.testing.assert_allclose(largest, np.maximum(distances - 0.03, 0.0) / 0.2)
    dq = np.linspace(-1, 1, robot.n_joints)
    later = np.array(
        [link.distance_m for link in links.nearest_points(robot.at(posture.q_rad + 1e-3 * dq), center, BALL_M)]
    )
    np.testing.assert_allclose(rows @ dq, (distances - later) / 1e-3, atol=2e-3)
    beside = links.nearest_points(posture, elbow + np.array([0.0, -0.08, 0.0]), BALL_M)
    assert clearance_rows(arm, beside)[1].min() == 0.0


def escape_of(robot: Robot, taxel: int, ball_m_s: float, distance_m: float, **params: float) -> Array | None:
    """The joint rates that leave the path of a ball that flies along a taxel's normal towards it."""
    points, normals = FOREARM.at(robot.at(home(robot)))
    track = track_at(points[taxel] + distance_m * normals[taxel], -ball_m_s * normals[taxel], radius_m=BALL_M)
    arm = arm_input(robot, activations=np.eye(12)[taxel], track=track, stamp_s=1.0)
    state, response = step(replace(AT_ONCE, **params), ArmState(), arm)
    if state.escape_rad_s is not None:
        columns = robot.indices(robot.names.arm("left"))
        rates = response.command.dq_rad_s[columns]
        assert np.linalg.norm(response.velocity_root) == pytest.approx(0.1, abs=1e-3)
        withdrawing, eq_6 = step(replace(AT_ONCE, escape_clearance_m=0.0), ArmState(), arm)
        assert withdrawing.escape_rad_s is None
        left_m = predicted_distances(arm, columns, np.array([rates, eq_6.command.dq_rad_s[columns]]))
        assert left_m[0] > left_m[1]
        state_after, _ = step(AT_ONCE, replace(state, escape_rad_s=0.98 * rates), replace(arm, stamp_s=1.05))
        np.testing.assert_allclose(state_after.escape_rad_s, rates, rtol=0.03)
    return state.escape_rad_s


@pytest.mark.parametrize(("speed_m_s", "escapes"), [(0.15, False), (0.2, True)])
def test_the_arm_moves_aside_where_withdrawal_leaves_less_than_five_centimetres(robot, speed_m_s, escapes):
    """As leaves more than withdrawal, and on as good as the best; of a ball 25 cm away withdrawal is predicted to leave
    5.5 to 6 cm, or 2 to 3 if it is faster."""
    for change, expected in (
        ({"escape_clearance_m": 0.02}, False),
        ({}, escapes),
        ({"escape_clearance_m": 0.06}, True),
        ({"escape_clearance_m": 0.0}, False),
    ):
        assert (escape_of(robot, 1, speed_m_s, 0.25, **change) is not None) == expected


def test_fewer_balls_that_fly_through_touch_where_taxels_may_leave_their_path(robot):
    """At 15–30 cm/s, within 45° of a taxel's normal."""
    rng = np.random.default_rng(4)
    variants = PARAMS, replace(PARAMS, escape_clearance_m=0.0), replace(PARAMS, threshold=1.0)
    n_taxels = len(BOTH_PARTS.taxel_ids)
    balls = [
        Ball(robot, BOTH_PARTS, int(rng.integers(n_taxels)), rng, rng.uniform(0.15, 0.30), turns=False)
        for _ in range(20)
    ]
    touched = [sum(ball.touches(params) for ball in balls) for params in variants]
    assert touched[2] == 20, "all of them touch an arm at rest"
    assert touched[0] <= 0.6 * touched[1]
