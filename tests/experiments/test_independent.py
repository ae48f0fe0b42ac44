"""The tracking table's study: goals, tables, baselines, and the same films by the renderer."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pps_vision.experiments.films.cases import CASES, Goal
from pps_vision.experiments.films.rendered import RenderedFilm
from pps_vision.experiments.films.scenes import Film, FilmScene
from pps_vision.experiments.films.score import BASELINES, OURS, measure_film
from pps_vision.types import Array

NOWHERE = Path("no such folder")
SMALL = FilmScene(width=320, height=240, seconds=2.0, fps=10.0, start="moving")


def test_goals_are_those_of_the_tracking_table() -> None:
    goals = {case.name: case.goals for case in CASES}
    assert goals["vivid, red"]["least_right_percent"] == (Goal(98, True),)
    assert goals["grey, entering"]["right_percent"] == (Goal(95, True),)
    assert goals["striped, spinning"]["radius_percent"] == (Goal(10),)
    assert [goals[f"head moves, {ms} ms stale"]["median_mm"][0].bound for ms in (0, 10, 20)] == [3, 5, 8]
    assert goals["marker, head moves, 20 ms stale"] == goals["head moves, grey, 20 ms stale"]
    assert goals["noise 10"]["right_percent"] == (Goal(90, True),)
    assert [goals[name]["ms_per_pair"][0].bound for name in ("noise 10", "1280x960, 60 fps")] == [5, 9]
    assert all(of["false_percent"] == (Goal(1),) for of in goals.values())


def test_baselines_are_told_the_object_where_all_of_it_is_seen_first() -> None:
    """On a vivid ball all are right; none can be before both eyes see the whole of it."""
    case = next(case for case in CASES if case.name == "vivid, red")
    film = Film(replace(SMALL, seconds=3.0, fps=20.0, start="entering"), 7301, NOWHERE)
    found = measure_film(case, film, True)
    assert list(found) == [OURS, *BASELINES]
    seen_s = next(row.stamp_s for row in film.truth if row.visible_left and row.visible_right)
    for name in BASELINES:
        assert found[name]["found_s"] == pytest.approx(film.stamps_s[film.first_boxes[0]] - seen_s)
    assert found["two CSRT"]["right_percent"] > 90
    assert list(measure_film(case, film, False)) == [OURS]


def centroid(image: Array, empty: Array) -> Array:
    """(2,) px of what changed."""
    weight = np.abs(image.astype(float) - empty).max(axis=2) > 20
    v, u = np.mgrid[: weight.shape[0], : weight.shape[1]]
    return np.array([(u * weight).sum(), (v * weight).sum()]) / weight.sum()


@pytest.mark.parametrize("rig", ["fixed", "rotating", "shaking", "head"])
def test_rendered_films_show_the_ball_where_its_truth_is(rig: str) -> None:
    scene = replace(SMALL, rig=rig, seconds=1.0, fps=5.0, distance_m=0.45, extent_m=0.08, shake_deg=1.0)
    film = RenderedFilm(scene, 7300)
    away = RenderedFilm(replace(scene, radius_m=1e-4), 7300)
    told_px = []
    for frame, bare, row in zip(film, away, film.truth, strict=True):
        for image, empty, pixel in ((frame.left, bare.left, row.left_px), (frame.right, bare.right, row.right_px)):
            np.testing.assert_allclose(centroid(image, empty), pixel, atol=1.0)
        told_px.append(film.rig.view_of(frame).left.project(row.position) - row.left_px)
    off = np.linalg.norm(told_px, axis=1).max()
    assert off > 1 if rig in ("rotating", "shaking") else off < 1e-3  # declared fixed


def test_rendered_films_have_the_patterns_and_the_finger_of_independent_ones() -> None:
    """Colours of the middle of the ball and of the finger, of both; a square is refused."""
    scene = replace(SMALL, rig="head", pattern="striped", finger=True, seconds=0.4, color=(25.0, 60.0, 210.0))
    for cast, drawn, row in zip(
        Film(scene, 7300, NOWHERE), RenderedFilm(scene, 7300), Film(scene, 7300).truth, strict=True
    ):
        u, v = np.rint(row.left_px).astype(int)
        ball = [image[v - 5 : v + 6, u - 5 : u + 6].astype(float) for image in (cast.left, drawn.left)]
        blueness = [patch[..., 2] - patch[..., 0] for patch in ball]
        assert np.corrcoef(blueness[0].ravel(), blueness[1].ravel())[0, 1] > 0.8
        below = [image[v + 40, u - 20 : u + 21].astype(float).std(axis=1).min() for image in (cast.left, drawn.left)]
        assert max(below) < 12  # a grey finger in both
    with pytest.raises(ValueError, match="a textured square"):
        RenderedFilm(replace(SMALL, shape="square", pattern="textured"), 1)
