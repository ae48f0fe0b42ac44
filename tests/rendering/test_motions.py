"""Motions: velocity is the derivative of position, speeds are as asked, paths go where they should."""

from typing import get_args

import numpy as np
import pytest

from rendering.motions import Approach, Circle, Figure8, Jerk, Linear, Motion, Recede, Target, make_motion, make_reach
from rendering.names import MotionName

CENTER = np.array([-0.3, -0.1, 0.12])
POINT = np.array([-0.25, -0.2, 0.05])
NORMAL = np.array([0.6, 0.0, 0.8])
TAXEL = Target(POINT, NORMAL, lambda start: POINT + 0.05 * (start - POINT) / np.linalg.norm(start - POINT))
SPEED = 0.10


def random_motion(kind: MotionName, seed: int) -> Motion:
    return make_motion(kind, np.random.default_rng(seed), CENTER, SPEED, TAXEL)


@pytest.mark.parametrize("kind", get_args(MotionName))
@pytest.mark.parametrize("seed", range(3))
def test_velocity_is_the_derivative_of_position(kind, seed):
    motion = random_motion(kind, seed)
    h = 1e-4
    errors = []
    for t in np.random.default_rng(seed).uniform(h, 12, 300):
        slope = (motion(t + h)[0] - motion(t - h)[0]) / (2 * h)
        errors.append(np.linalg.norm(slope - motion(t)[1]))
    assert np.percentile(errors, 98) < 0.002 * SPEED  # a corner may fall between the two samples
    assert np.median(errors) < 0.002 * SPEED


@pytest.mark.parametrize("kind", ["circle", "figure8", "linear"])
def test_motions_in_the_air_keep_their_speed_and_stay_near(kind):
    for seed in range(5):
        states = [random_motion(kind, seed)(t) for t in np.linspace(0, 20, 400)]
        away = [np.linalg.norm(p - CENTER) for p, _ in states]
        assert np.allclose([np.linalg.norm(v) for _, v in states], SPEED, rtol=1e-9)
        assert max(away) <= 0.08 + 1e-9
        assert max(away) >= 0.049


def test_an_approach_starts_in_the_cone_ends_before_the_taxel_and_withdraws_along_its_path():
    point = POINT
    normal = NORMAL
    for seed in range(50):
        motion = random_motion("approach", seed)
        assert isinstance(motion, Approach)
        away = motion(0.0)[0] - point
        assert 0.25 <= np.linalg.norm(away) <= 0.30
        assert away @ normal / np.linalg.norm(away) >= np.cos(np.deg2rad(45)) - 1e-9
        end, velocity = motion(motion.contact_s + 0.5 * motion.dwell_s)
        assert end - point == pytest.approx(0.05 * away / np.linalg.norm(away), abs=1e-9)
        assert not velocity.any()
        for before_s in (0.2, 1.0):
            approaching = motion(motion.contact_s - before_s)
            back = motion(motion.contact_s + motion.dwell_s + before_s)
            assert approaching[0] == pytest.approx(back[0], abs=1e-9)
            assert approaching[1] == pytest.approx(-back[1], abs=1e-9)
            assert np.linalg.norm(approaching[1]) == pytest.approx(SPEED)
            assert np.linalg.norm(approaching[0] - end) == pytest.approx(before_s * SPEED)
        assert np.array_equal(motion(100.0)[0], motion(0.0)[0])


def test_reaches_bow_as_stated_and_arrive_at_speed():
    """At half of the path a curve has gone half of the way that its control point is aside, 0.15 of the length."""
    rng = np.random.default_rng(3)
    bows = []
    for _ in range(300):
        reach = make_reach(rng, POINT, NORMAL, 0.3, 0.5)
        path = np.array([reach(t)[0] for t in np.linspace(0, reach.arrives_s, 201)])
        np.testing.assert_allclose(path[-1], POINT, atol=1e-6)
        assert np.linalg.norm(path[0] - POINT) == pytest.approx(0.3)
        assert (path[0] - POINT) @ NORMAL > 0
        assert np.linalg.norm(reach(reach.arrives_s)[1]) > 0.05
        chord = (path[-1] - path[0]) / 0.3
        aside = (path - path[0]) - np.outer((path - path[0]) @ chord, chord)
        middle = np.argmin(np.abs((path - path[0]) @ chord - 0.15))
        bows.append(np.linalg.norm(aside[middle]))
    assert np.sqrt(np.mean(np.square(bows)) / 2) == pytest.approx(0.075 * 0.3, rel=0.1)  # of two lateral axes


def test_a_linear_motion_goes_from_its_start_to_its_end_and_back():
    motion = Linear(np.zeros(3), np.array([0.0, 0.3, 0.4]), 0.1)  # 5 s one way
    places = [motion(t)[0] for t in (0.0, 2.0, 5.0, 6.0, 10.0, 12.0)]
    np.testing.assert_allclose(places, np.outer([0, 0.4, 1, 0.8, 0, 0.4], [0.0, 0.3, 0.4]), atol=1e-12)


X, Y, Z = np.eye(3)


def test_a_circle_is_where_its_angle_says():
    motion = Circle(CENTER, np.array([X, Z]), 0.06, 0.12)
    quarter_s = np.pi / 2 * 0.06 / 0.12
    for k, (away, heading) in enumerate(((X, Z), (Z, -X), (-X, -Z), (-Z, X), (X, Z))):
        position, velocity = motion(k * quarter_s)
        assert position == pytest.approx(CENTER + 0.06 * away)
        assert velocity == pytest.approx(0.12 * heading)


def test_a_figure_of_eight_crosses_its_centre_and_turns_at_its_ends():
    """Gerono's lemniscate is 6.09722 times its half length long."""
    motion = Figure8(CENTER, np.array([X, Z]), 0.06, 0.12)
    period_s = 6.0972235 * 0.06 / 0.12
    diagonal = np.sqrt(0.5)
    passes = ((0, 0 * X, (X + Z) * diagonal), (1, X, -Z), (2, 0 * X, (Z - X) * diagonal), (3, -X, -Z))
    for quarter, away, heading in passes:
        position, velocity = motion(quarter * period_s / 4 + period_s)
        assert position == pytest.approx(CENTER + 0.06 * away, abs=1e-5)
        assert velocity == pytest.approx(0.12 * heading, abs=1e-3)


def test_jerk_moves_and_pauses_for_as_long_as_its_ways_take():
    """From waypoint 0 to 1 (30 cm) and back: each move lasts 15/8 of its way over its peak speed."""
    motion = Jerk(np.array([0 * X, 0.3 * X]), 0.5, pause_s=0.4)
    move_s = 15 / 8 * 0.3 / 0.5
    assert motion(0.0)[0] == pytest.approx(0.15 * X)
    assert motion(0.0)[1] == pytest.approx(0.5 * X)
    for t in (move_s / 2, move_s / 2 + 0.39):
        assert motion(t)[0] == pytest.approx(0.3 * X, abs=1e-6)
        assert motion(t)[1] == pytest.approx(0 * X, abs=1e-6)
    assert motion(move_s + 0.4)[0] == pytest.approx(0.15 * X)
    assert motion(move_s + 0.4)[1] == pytest.approx(-0.5 * X)
    assert motion(0.75 * move_s + 0.4)[0] == pytest.approx((0.3 - 0.3 * (10 / 4**3 - 15 / 4**4 + 6 / 4**5)) * X)
    assert motion(2 * (move_s + 0.4))[0] == pytest.approx(motion(0.0)[0])
    usual = Jerk(np.array([0 * X, 0.3 * X]), 0.5)
    assert usual(move_s + 0.2)[1] == pytest.approx(-0.5 * X)  # the middle of the way back, after 0.2 s


def test_a_recede_is_an_approach_reversed():
    near_end = random_motion("approach", 4)
    far_end = random_motion("recede", 4)
    assert isinstance(near_end, Approach)
    assert isinstance(far_end, Recede)
    for t in np.linspace(0, near_end.contact_s, 7):
        assert far_end(t)[0] == pytest.approx(near_end(near_end.contact_s - t)[0], abs=1e-9)
    assert not far_end(100.0)[1].any()
