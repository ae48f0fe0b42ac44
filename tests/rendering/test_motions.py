"""Motions: velocity is the derivative of position, speeds are as asked, paths go where they should."""

from typing import get_args

import numpy as np
import pytest

from rendering.motions import Approach, Jerk, Linear, Motion, Recede, Target, make_motion, make_reach
from rendering.names import MotionName

CENTER = np.array([-0.3, -0.1, 0.12])
POINT, NORMAL = np.array([-0.25, -0.2, 0.05]), np.array([0.6, 0.0, 0.8])
TAXEL = Target(POINT, NORMAL, lambda start: POINT + 0.05 * (start - POINT) / np.linalg.norm(start - POINT))
SPEED = 0.10


def random_motion(kind: MotionName, seed: int) -> Motion:
    return make_motion(kind, np.random.default_rng(seed), CENTER, SPEED, TAXEL)


@pytest.mark.parametrize("kind", get_args(MotionName))
@pytest.mark.parametrize("seed", range(3))
def test_velocity_is_the_derivative_of_position(kind: MotionName, seed: int) -> None:
    motion, h = random_motion(kind, seed), 1e-4
    errors = []
    for t in np.random.default_rng(seed).uniform(h, 12, 300):
        slope = (motion(t + h)[0] - motion(t - h)[0]) / (2 * h)
        errors.append(np.linalg.norm(slope - motion(t)[1]))
    assert np.percentile(errors, 98) < 0.002 * SPEED  # a corner may fall between the two samples
    assert np.median(errors) < 0.002 * SPEED


@pytest.mark.parametrize("kind", ["circle", "figure8", "linear"])
def test_motions_in_the_air_keep_their_speed_and_stay_near(kind: MotionName) -> None:
    for seed in range(5):
        states = [random_motion(kind, seed)(t) for t in np.linspace(0, 20, 400)]
        away = [np.linalg.norm(p - CENTER) for p, _ in states]
        assert np.allclose([np.linalg.norm(v) for _, v in states], SPEED, rtol=1e-9)
        assert max(away) <= 0.08 + 1e-9
        assert max(away) >= 0.049


def test_paths_differ_between_draws_and_repeat_with_the_seed() -> None:
    for kind in ("approach", "recede", "circle", "figure8", "linear", "jerk"):
        assert np.array_equal(random_motion(kind, 1)(0.7)[0], random_motion(kind, 1)(0.7)[0])
        assert not np.array_equal(random_motion(kind, 1)(0.7)[0], random_motion(kind, 2)(0.7)[0])


def test_static_stays() -> None:
    motion = random_motion("static", 0)
    for t in (0.0, 3.0):
        assert np.array_equal(motion(t)[0], CENTER)
        assert not motion(t)[1].any()


def test_an_approach_starts_in_the_cone_ends_before_the_taxel_and_withdraws_along_its_path() -> None:
    point, normal = POINT, NORMAL
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
            there, back = motion(motion.contact_s - before_s), motion(motion.contact_s + motion.dwell_s + before_s)
            assert there[0] == pytest.approx(back[0], abs=1e-9)
            assert there[1] == pytest.approx(-back[1], abs=1e-9)
            assert np.linalg.norm(there[1]) == pytest.approx(SPEED)
            assert np.linalg.norm(there[0] - end) == pytest.approx(before_s * SPEED)
        assert np.array_equal(motion(100.0)[0], motion(0.0)[0])


def test_starts_fill_the_cap_around_the_normal_evenly() -> None:
    point, normal = POINT, NORMAL
    starts = np.array([random_motion("approach", seed)(0.0)[0] - point for seed in range(400)])
    cosine = starts @ normal / np.linalg.norm(starts, axis=1)
    # on a sphere, area grows with the cosine: half of the cap lies below its mean
    assert np.mean(cosine < (1 + np.cos(np.deg2rad(45))) / 2) == pytest.approx(0.5, abs=0.1)


def test_reaches_bow_as_stated_and_arrive_at_speed() -> None:
    """At half of the path a curve has gone half of the way that its control point is aside, 0.15 of the length."""
    rng, bows = np.random.default_rng(3), []
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


def test_a_linear_motion_goes_from_its_start_to_its_end_and_back() -> None:
    motion = Linear(np.zeros(3), np.array([0.0, 0.3, 0.4]), 0.1)  # 5 s one way
    places = [motion(t)[0] for t in (0.0, 2.0, 5.0, 6.0, 10.0, 12.0)]
    np.testing.assert_allclose(places, np.outer([0, 0.4, 1, 0.8, 0, 0.4], [0.0, 0.3, 0.4]), atol=1e-12)


def test_a_recede_is_an_approach_reversed() -> None:
    near_end, far_end = random_motion("approach", 4), random_motion("recede", 4)
    assert isinstance(near_end, Approach)
    assert isinstance(far_end, Recede)
    for t in np.linspace(0, near_end.contact_s, 7):
        assert far_end(t)[0] == pytest.approx(near_end(near_end.contact_s - t)[0], abs=1e-9)
    assert not far_end(100.0)[1].any()


def test_jerk_stops_at_its_waypoints_and_peaks_at_its_speed() -> None:
    motion = random_motion("jerk", 0)
    assert isinstance(motion, Jerk)
    states = [motion(t) for t in np.arange(0, 40, 0.005)]
    speeds = np.array([np.linalg.norm(v) for _, v in states])
    assert speeds.max() == pytest.approx(SPEED, rel=1e-3)
    resting = np.array([p for (p, _), s in zip(states, speeds, strict=True) if s < 1e-12])
    for waypoint in motion.waypoints:
        assert np.linalg.norm(resting - waypoint, axis=1).min() < 1e-6
    assert max(np.linalg.norm(p - CENTER) for p, _ in states) <= 0.08 + 1e-9
    # the mean of a minimum-jerk move is 8/15 of its peak
    moving = speeds[speeds > 1e-12]
    assert moving.mean() == pytest.approx(SPEED * 8 / 15, rel=0.02)


def test_senseless_motions_are_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match=r"motion: 'hop'.*approach"):
        make_motion("hop", rng, CENTER, SPEED)  # type: ignore[arg-type]
    for speed in (0.0, -0.1, np.nan):
        with pytest.raises(ValueError, match="expected a positive number"):
            make_motion("circle", rng, CENTER, speed)
    with pytest.raises(ValueError, match="needs a target"):
        make_motion("approach", rng, CENTER, SPEED)
