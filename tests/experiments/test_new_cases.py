"""The first cases' paths are as they were; what a new case's name says happens in its film."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pps_vision.experiments.films.cases import CASES, NEW_CASES
from pps_vision.experiments.films.scenes import DARK_S, Film
from pps_vision.experiments.films.score import score_of_film
from pps_vision.types import Array, Track3D

BY_NAME = {case.name: case for case in (*CASES, *NEW_CASES)}


def film_of(name: str, seed: int = 0, fps: float = 10.0) -> Film:
    return Film(replace(BY_NAME[name].scene(seed), fps=fps), seed, Path("absent"))


def places(film: Film, k: int = 0) -> Array:
    """(n, 3) m in the left eye at rest."""
    return np.array([row.position for row in film.truths[k]])


def test_the_first_cases_move_as_they_did():
    """Positions at 1 s, drawn before there were several objects."""
    assert len(CASES) == 58
    before = {
        "vivid, red": (-0.0938372, 0.0858476, 0.6071979),
        "behind a board for 1 s": (0.2545271, -0.0407527, 0.5511944),
        "1 m/s, instant reversal": (0.1277265, -0.0176729, 0.5836261),
        "moves, stops for 2 s, moves on": (0.1768955, -0.0347266, 0.572347),
        "head moves, 0 ms stale": (-0.4881118, 0.0739049, 0.3174527),
    }
    for name, expected in before.items():
        np.testing.assert_allclose(places(film_of(name, 3))[10], expected, atol=1e-6)
    np.testing.assert_allclose(
        places(film_of("two balls of one colour", 3), 1)[10], (0.2138372, -0.0858476, 0.7428021), atol=1e-6
    )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", ["hand holds", "hand takes"])
def test_a_hand_hides_about_a_third_differently_for_both_eyes(name, seed):
    film = film_of(name, seed)
    hidden = 1 - film.share
    grasped = film.stamps_s >= (2.5 if name == "hand takes" else 0.0)
    assert hidden[grasped].min() > 0.05
    assert hidden[grasped].max() < 0.65
    assert 0.15 < hidden[grasped].mean() < 0.5
    assert np.abs(hidden[grasped, 0] - hidden[grasped, 1]).max() > 0.015
    assert name == "hand holds" or hidden[film.stamps_s < 1.8].max() == 0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", ["first rests", "walker", "nearer comes later"])
def test_what_comes_later_comes_straight_at_the_eyes(name, seed):
    film = film_of(name, seed)
    seen = np.array([row.visible_left and row.visible_right for row in film.truth])
    assert 1.5 <= film.awaited_s < 4
    assert film.stamps_s[seen][0] == film.awaited_s
    assert seen[film.stamps_s > film.awaited_s].mean() > 0.8
    p = places(film)[-10:] - np.array([0.06, 0, 0])  # from midway between the eyes
    away = np.linalg.norm(p, axis=1)
    np.testing.assert_allclose(np.diff(away), -0.03, atol=1e-9)
    np.testing.assert_allclose(p / away[:, None], np.tile(p[0] / away[0], (10, 1)), atol=1e-9)
    for k in range(1, len(film.truths)):
        other = places(film, k)
        assert film.truths[k][0].visible_left
        assert name == "nearer comes later" or np.ptp(other[film.stamps_s >= 1.5], axis=0).max() == 0
        assert np.linalg.norm(p[-1]) < np.linalg.norm(other[-1])
        assert np.linalg.norm(places(film) - other, axis=1).min() > 0.07
    unknown = [[Track3D.unknown(row.stamp_s)] for row in film.truth]
    assert score_of_film(unknown, film.truths[:1], film.awaited_s)["known_percent"] == 0


def test_two_balls_cross_and_both_go_on():
    film = film_of("two of one colour cross")
    apart = np.array([[row.left_px[0] for row in truth] for truth in film.truths]).T
    both = [all(row.visible_left for row in rows) for rows in zip(*film.truths, strict=True)]
    sides = np.sign(np.diff(apart[both], axis=1).ravel())
    assert sides[0] == -sides[-1] != 0
    assert np.count_nonzero(np.diff(sides)) == 1


@pytest.mark.parametrize(("name", "rate"), [("rod at 45°", 0.0), ("turning stick", 1.5)])
def test_a_rod_stands_oblique_and_turns_at_its_rate(name, rate):
    film = film_of(name)
    solids = [film.solids(t)[0] for t in (0.0, 0.1)]
    angles = [np.arctan2(*(solid.half[:2] / np.linalg.norm(solid.half))[::-1]) for solid in solids]
    assert np.degrees(angles[0]) % 90 == pytest.approx(45, abs=3)
    assert abs(angles[1] - angles[0]) == pytest.approx(0.1 * rate, abs=0.01)
    assert [2 * np.linalg.norm(solids[0].half), 2 * solids[0].radius_m] == pytest.approx([0.2, 0.02])


def test_nothing_is_visible_in_the_dark():
    film = film_of("light off and on")
    dark = (film.stamps_s >= 2) & (film.stamps_s < 2 + DARK_S)
    assert not film.share[dark].any()
    assert film.share[film.stamps_s >= 2 + DARK_S].min() == 1
    means = np.array([frame.left.mean() for frame in film])
    assert means[dark].max() < 0.1 * means[~dark].min()


def test_a_throw_is_a_parabola_at_3_m_s_across_the_view():
    film = film_of("thrown at 3 m/s", fps=100.0)
    speed = np.array([np.linalg.norm(row.velocity) for row in film.truth])
    p = places(film)
    fall = np.diff(p, n=2, axis=0) * 100.0**2
    flying = (film.stamps_s[2:] > 0.55) & (film.stamps_s[2:] < 1.25)
    np.testing.assert_allclose(fall[flying], np.tile([0, 9.81, 0], (flying.sum(), 1)), atol=1e-6)
    assert speed[film.stamps_s >= 0.5][0] == pytest.approx(3.0, rel=0.02)
    seen = film.share.min(axis=1) >= 0.5
    assert 3 <= np.count_nonzero(np.diff(seen.astype(int)) == 1) <= 5
