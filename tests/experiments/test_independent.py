"""The tracking table's study: goals, tables, baselines, and the same films by the renderer."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pps_vision.experiments.films.cases import CASES
from pps_vision.experiments.films.rendered import RenderedFilm
from pps_vision.experiments.films.scenes import Film, FilmScene
from pps_vision.experiments.films.score import BASELINES, OURS, measure_film
from pps_vision.types import Array

NOWHERE = Path("no such folder")
SMALL = FilmScene(width=320, height=240, seconds=2.0, fps=10.0, start="moving")


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
