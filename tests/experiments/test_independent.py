"""The tracking table's study: goals, tables, baselines, and the same films by the renderer."""

from dataclasses import replace

import numpy as np
import pytest

from pps_vision.experiments.films.rendered import RenderedFilm
from pps_vision.experiments.films.scenes import FilmScene
from pps_vision.types import Array

SMALL = FilmScene(width=320, height=240, seconds=2.0, fps=10.0, start="moving")


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
