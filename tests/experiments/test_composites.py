"""Composite films: their boxes are those of what is drawn."""

from pathlib import Path

import numpy as np
import pytest

from pps_vision.experiments.composites import DIFFICULTIES, Difficulty, composite


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_a_film_is_of_one_size_and_its_boxes_are_in_view(difficulty: Difficulty) -> None:
    film = composite(difficulty, (0, 1, 2), Path("absent"), np.random.default_rng(5), n=8, shape=(120, 160))
    assert {image.shape for image in film.images} == {(120, 160, 3)}
    assert len(film.images) == len(film.boxes) == len(film.visible) == 8
    for x, y, w, h in film.boxes:
        assert x >= 0 <= y
        assert x + w <= 160
        assert y + h <= 120
        assert min(w, h) > 3
    assert film.visible[0] > 0.9


def test_the_box_is_around_what_differs_from_a_film_without_motion() -> None:
    """A vivid object over a scene: nearly all pixels of its hue lie in its box, and reach its sides."""
    film = composite("vivid", (0, 1), Path("absent"), np.random.default_rng(3), n=3, shape=(240, 360))
    for image, (x, y, w, h) in zip(film.images, film.boxes, strict=True):
        x0, y0, x1, y1 = int(x), int(y), int(x + w), int(y + h)
        center = image[(y0 + y1) // 2, (x0 + x1) // 2].astype(float)
        like = np.abs(image.astype(float) - center).max(axis=2) < 30
        ys, xs = np.nonzero(like)
        inside = (xs >= x0 - 1) & (xs <= x1) & (ys >= y0 - 1) & (ys <= y1)
        assert inside.mean() > 0.95
        assert xs[inside].min() < x0 + 0.25 * w
        assert xs[inside].max() > x1 - 0.25 * w
