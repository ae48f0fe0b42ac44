"""The predicted distance against a simulation of the same motion, and flights that withdrawal does not escape."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from control.arm import ArmParams, MovingPoint, arm_constraints, arm_velocity
from control.avoidance import AvoidanceParams, AvoidanceState, step
from control.path_clearance import direction_off_path, predicted_distances
from pps_vision.robot.icub import HOME_ARM_RAD, home
from pps_vision.robot.model import Robot
from pps_vision.robot.skin import TOUCH_RADIUS_M, Skin, SkinPart, icub_skin, touched_taxels
from pps_vision.types import Array, Status, Track3D

DT = 0.05
BALL_M = 0.035
SKIN = icub_skin(("left_forearm", "left_palm"))


def track_at(position: Array, velocity: Array) -> Track3D:
    mean = np.array([position, velocity, np.zeros(3), np.zeros(3)])
    return Track3D(0.0, mean, 1e-8 * np.eye(12), BALL_M, 1e-8, Status.TRACKING)


def arm_of(robot: Robot) -> list[int]:
    return robot.indices(robot.names.arm("left"))


def test_predicted_distance_is_that_of_the_simulated_motion(robot: Robot, rng: np.random.Generator) -> None:
    """A ball passes the arm that turns slowly; the simulation turns joints and asks the kinematics 400 times."""
    q, columns = home(robot), arm_of(robot)
    posture = robot.at(q)
    taxels, normals = SKIN.at(posture)
    for taxel in (0, 5, 9, 13):
        across = np.cross(normals[taxel], rng.standard_normal(3))
        velocity = 0.2 * across / np.linalg.norm(across)
        start = taxels[taxel] + 0.1 * normals[taxel] - 0.6 * velocity
        rates = 0.08 * rng.uniform(-1, 1, (2, len(columns)))
        found = predicted_distances(posture, columns, SKIN, rates, track_at(start, velocity))
        for rate, predicted in zip(rates, found, strict=True):
            least = np.inf
            for t in np.linspace(0.0, 1.5, 400):
                later = q.copy()
                later[columns] = np.clip(q[columns] + t * rate, robot.lower_rad[columns], robot.upper_rad[columns])
                d = np.linalg.norm(SKIN.at(robot.at(later))[0] - start - t * velocity, axis=1)
                least = min(least, float(d.min()) - BALL_M)
            assert predicted == pytest.approx(least, abs=0.006)


def test_a_joint_at_its_limit_is_predicted_to_stay(robot: Robot) -> None:
    q, columns = home(robot), arm_of(robot)
    q[columns] = robot.upper_rad[columns] - 1e-9
    posture = robot.at(q)
    ball = track_at(SKIN.at(posture)[0][0] + [0.0, 0.0, 0.3], np.array([0.0, 0.0, -0.1]))
    rests, pushes = predicted_distances(posture, columns, SKIN, np.array([np.zeros(7), np.ones(7)]), ball)
    assert pushes == pytest.approx(rests, abs=1e-6)


@pytest.mark.parametrize(
    ("ahead_m", "speed_m_s", "left_m"),
    [(0.55, 0.3, 0.0), (1.0, 0.05, 0.85), (-0.2, 1.2, 0.21)],
    ids=["passes", "in three seconds", "has passed"],
)
def test_an_object_is_followed_to_five_centimetres_beyond_the_last_taxel(
    robot: Robot, ahead_m: float, speed_m_s: float, left_m: float
) -> None:
    """At twelve instants, here 5 cm apart, of three seconds at most, or of a tenth of one at least."""
    way, posture = np.array([0.6, 0.0, 0.8]), robot.at(home(robot))
    skin = Skin((SkinPart("one", "left_palm", (0,), np.zeros((1, 3)), np.eye(3)[2:]),))
    track = track_at(posture.point("left_palm") - ahead_m * way, speed_m_s * way)
    (found,) = predicted_distances(posture, arm_of(robot), skin, np.zeros((1, 7)), track)
    assert found == pytest.approx(left_m - BALL_M, abs=1e-6)


def all_of_it(rates: Array) -> float:
    """What the body leaves of rates far from it."""
    return 1.0


def withdrawing(robot: Robot, taxel: int) -> Callable[[Array | None], Array]:
    """Rates of an arm whose taxel moves at 10 cm/s in a direction, or against its normal."""
    posture, params = robot.at(home(robot)), ArmParams()
    constraints = arm_constraints(params, posture, "left", HOME_ARM_RAD)
    part_k = int(SKIN.part_index[taxel])
    part, k = SKIN.parts[part_k], taxel - int(np.flatnonzero(SKIN.part_index == part_k)[0])
    normal = SKIN.at(posture)[1][taxel]

    def rates_towards(direction: Array | None) -> Array:
        velocity = 0.1 * (-normal if direction is None else direction)
        point = MovingPoint(part.frame, part.positions_m[k], velocity, free_across=True)
        return arm_velocity(params, posture, constraints, [point])[arm_of(robot)]

    return rates_towards


def test_no_direction_is_needed_for_what_misses_rests_or_is_escaped(robot: Robot) -> None:
    posture = robot.at(home(robot))
    taxels, normals = SKIN.at(posture)
    taxel = SKIN.index("left_forearm:27")
    far, way = taxels[taxel] + 0.25 * normals[taxel], -normals[taxel]
    aside = np.cross(way, taxels[taxel] - posture.point("left_palm"))
    for position, velocity in (
        (far, np.zeros(3)),  # rests
        (far, -0.2 * way),  # recedes
        (far + 0.4 * aside / np.linalg.norm(aside), 0.2 * way),  # misses
    ):
        track = track_at(position, velocity)
        rates_towards = withdrawing(robot, taxel)
        assert direction_off_path(posture, arm_of(robot), SKIN, track, rates_towards, 0.05, None, all_of_it) is None


def test_another_direction_is_looked_for_where_withdrawal_leaves_too_little(robot: Robot) -> None:
    """A millimetre more or less than is left; and of the withdrawal counts what the body leaves of it."""
    posture, taxel = robot.at(home(robot)), SKIN.index("left_forearm:27")
    taxels, normals = SKIN.at(posture)
    track = track_at(taxels[taxel] + 0.15 * normals[taxel], -0.3 * normals[taxel])
    rates_towards = withdrawing(robot, taxel)
    given = posture, arm_of(robot), SKIN, track
    for share in (1.0, 0.5):
        (left_m,) = predicted_distances(*given[:3], share * rates_towards(None)[None], track)
        assert direction_off_path(*given, rates_towards, left_m - 0.001, None, lambda rates, s=share: s) is None  # type: ignore[misc]
        assert direction_off_path(*given, rates_towards, left_m + 0.001, None, lambda rates, s=share: s) is not None  # type: ignore[misc]


@pytest.mark.parametrize(("speed_m_s", "expected"), [(0.009, False), (0.012, True)])
def test_what_is_slower_than_a_centimetre_per_second_has_no_path(
    robot: Robot, speed_m_s: float, expected: bool
) -> None:
    """A ball at the skin that cannot withdraw."""
    posture, taxel = robot.at(home(robot)), SKIN.index("left_forearm:27")
    taxels, normals = SKIN.at(posture)
    track = track_at(taxels[taxel] + (BALL_M + 0.01) * normals[taxel], -speed_m_s * normals[taxel])
    moves = withdrawing(robot, taxel)
    given = posture, arm_of(robot), SKIN, track, lambda one: moves(one) * (one is not None), 0.5
    assert (direction_off_path(*given, None, all_of_it) is not None) == expected


@pytest.mark.parametrize(("better_m", "expected"), [(0.008, False), (0.012, True)])
def test_withdrawal_is_preferred_to_what_leaves_less_than_a_centimetre_more(
    robot: Robot, better_m: float, expected: bool
) -> None:
    """All directions move the taxels alike, by so much farther from a ball that flies at them."""
    posture, columns, taxel = robot.at(home(robot)), arm_of(robot), SKIN.index("left_forearm:27")
    taxels, normals = SKIN.at(posture)
    track = track_at(taxels[taxel] + 0.15 * normals[taxel], -0.3 * normals[taxel])
    withdraws = withdrawing(robot, taxel)(None)

    def left_m(faster: float) -> float:
        return float(predicted_distances(posture, columns, SKIN, faster * withdraws[None], track)[0])

    faster = brentq(lambda faster: left_m(faster) - left_m(1.0) - better_m, 1.0, 3.0)
    given = posture, columns, SKIN, track, lambda one: withdraws * (1.0 if one is None else faster), 0.5
    assert (direction_off_path(*given, None, all_of_it) is not None) == expected


def test_a_direction_in_which_the_body_slows_the_arm_is_judged_by_what_is_left(robot: Robot) -> None:
    """A fast ball flies through a taxel; the motion that clears it farthest is slowed to nothing, then all motions."""
    posture, taxel = robot.at(home(robot)), SKIN.index("left_forearm:27")
    taxels, normals = SKIN.at(posture)
    track = track_at(taxels[taxel] + 0.15 * normals[taxel], -0.3 * normals[taxel])
    rates_towards = withdrawing(robot, taxel)
    given = posture, arm_of(robot), SKIN, track, rates_towards, 0.05, None
    freely = direction_off_path(*given, all_of_it)
    assert freely is not None
    best = rates_towards(freely)
    other = direction_off_path(*given, free_share=lambda rates: float(not np.array_equal(rates, best)))
    assert other is not None
    assert not np.array_equal(other, freely)
    assert direction_off_path(*given, free_share=lambda rates: 0.9) is not None
    assert direction_off_path(*given, free_share=lambda rates: 0.0) is None


def fly_through(robot: Robot, params: AvoidanceParams, taxel: int, way: Array, speed_m_s: float) -> bool:
    """Whether a ball that flies straight on through a taxel's place at home touches the arm; the taxels that it comes
    to within a second are activated.  The ball and the robot's kinematics alone decide."""
    q, state = home(robot), AvoidanceState()
    aim = SKIN.at(robot.at(q))[0][taxel]
    for k in range(int(0.45 / speed_m_s / DT)):
        posture = robot.at(q)
        taxels, normals = SKIN.at(posture)
        center = aim + (k * DT * speed_m_s - 0.28) * way
        d = center - taxels
        ahead = d @ -way
        near = (ahead > 0) & (ahead - BALL_M < 1.0 * speed_m_s) & (np.sum(d * normals, axis=1) > 0)
        near &= np.linalg.norm(d - ahead[:, None] * -way, axis=1) < BALL_M + TOUCH_RADIUS_M
        track = replace(track_at(center, speed_m_s * way), stamp_s=k * DT)
        state, command, _ = step(params, state, posture, SKIN, near.astype(float), k * DT, hold_s=DT, track=track)
        for share in (0.25, 0.5, 0.75, 1.0):
            moved = SKIN.at(robot.at(q + share * DT * command.dq_rad_s))[0]
            if touched_taxels(moved, center + share * DT * speed_m_s * way, BALL_M).any():
                return True
        q = q + DT * command.dq_rad_s
    return False


def test_fewer_balls_that_fly_through_touch_where_taxels_may_leave_their_path(robot: Robot) -> None:
    """At 15–30 cm/s, within 45° of the normal of every third taxel."""
    rng = np.random.default_rng(4)
    clears = AvoidanceParams(HOME_ARM_RAD)
    by_normals = replace(clears, clear_m=0.0)
    _, normals = SKIN.at(robot.at(home(robot)))
    touched = np.zeros(3)
    for _ in range(12):
        taxel = int(rng.integers(len(normals)))
        aside = np.cross(normals[taxel], rng.standard_normal(3))
        angle = rng.uniform(0, np.pi / 4)
        way = -np.cos(angle) * normals[taxel] - np.sin(angle) * aside / np.linalg.norm(aside)
        flight = taxel, way, rng.uniform(0.15, 0.30)
        touched += [fly_through(robot, p, *flight) for p in (clears, by_normals, replace(clears, threshold=1.0))]
    assert touched[2] == 12, "all of them touch an arm at rest"
    assert touched[0] <= 0.6 * touched[1]


def test_eight_directions_all_around_the_path_are_tried(robot: Robot) -> None:
    """Of unit length, across it, 45° apart."""
    posture, taxel, tried = robot.at(home(robot)), SKIN.index("left_forearm:27"), list[Array]()
    taxels, normals = SKIN.at(posture)
    track = track_at(taxels[taxel] + 0.15 * normals[taxel], -0.3 * normals[taxel])

    def rates_towards(direction: Array | None) -> Array:
        if direction is not None:
            tried.append(direction)
        return np.zeros(7)

    assert direction_off_path(posture, arm_of(robot), SKIN, track, rates_towards, 0.5, None, all_of_it) is None
    cosines = np.sort(np.array(tried) @ np.array(tried).T, axis=1)
    np.testing.assert_allclose(np.array(tried) @ normals[taxel], 0.0, atol=1e-9)
    np.testing.assert_allclose(cosines, np.tile(np.sort(np.cos(np.arange(8) * np.pi / 4)), (8, 1)), atol=1e-9)


def test_the_direction_lies_across_the_path_and_is_kept(robot: Robot) -> None:
    """It is not given up for one that is better by less than a centimetre."""
    posture = robot.at(home(robot))
    taxels, normals = SKIN.at(posture)
    found, kept_once = 0, False
    for taxel in range(len(taxels)):
        way = -normals[taxel]
        track = track_at(taxels[taxel] - 0.15 * way, 0.25 * way)
        given = posture, arm_of(robot), SKIN, track, withdrawing(robot, taxel), 0.05
        direction = direction_off_path(*given, None, all_of_it)
        if direction is None:
            continue
        found += 1
        assert np.linalg.norm(direction) == pytest.approx(1)
        assert direction @ way == pytest.approx(0, abs=1e-9)
        turned = np.cos(0.02) * direction + np.sin(0.02) * np.cross(way, direction)
        kept = direction_off_path(*given, turned, all_of_it)
        assert kept is not None
        rates = np.array([given[4](one) for one in (direction, turned)])
        best_m, turned_m = predicted_distances(*given[:3], rates, track)
        np.testing.assert_allclose(kept, turned if best_m < turned_m + 0.01 else direction)
        kept_once = kept_once or best_m < turned_m + 0.01
    assert found >= 3
    assert kept_once
