"""True boxes against what is drawn, and the comparison against a square that jumps where it is told to."""

import numpy as np
import pytest

from pps_vision.experiments.baselines.image_trackers import image_tracker
from pps_vision.experiments.films.recordings import moving
from pps_vision.experiments.imagetracker import DEFAULT, HueBlob, ParticleTracker, View, methods


def test_the_true_box_is_the_drawn_ball_s() -> None:
    film = moving("ball", "circle", 3, 0.1, noise=0.0)
    for frame, boxes in zip(film.frames, film.boxes, strict=True):
        for image, box in zip((frame.left, frame.right), boxes, strict=True):
            assert box is not None
            red = (image[..., 0] > 90) & (image[..., 1] < 0.35 * image[..., 0])  # brighter than half its edge
            columns, rows = np.flatnonzero(red.any(axis=0)), np.flatnonzero(red.any(axis=1))
            drawn = (columns[0], rows[0], columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1)
            assert np.allclose(box, drawn, atol=1.2)


def test_a_square_that_jumps_is_held_by_who_looks_everywhere() -> None:
    """Centres and overlaps are those of the squares that were drawn."""
    rng = np.random.default_rng(0)
    images, boxes = [], []
    for k in range(12):
        image = rng.integers(100, 140, (120, 160, 3), dtype=np.uint8)
        x, y = (20 + 2 * k, 30) if k < 6 else (110, 70 - 2 * k)
        image[y : y + 20, x : x + 20] = (230, 20, 20)
        images.append(image)
        boxes.append((float(x), float(y), 20.0, 20.0))
    view = View(tuple(images), tuple(boxes), hue_deg=0.0)
    blob, kcf, particles = (methods()[name](view, 0) for name in ("marker blob", "KCF", DEFAULT))
    assert np.mean(blob["held"]) == pytest.approx(10 / 11)  # it looks around the last place first
    assert np.median(blob["center_px"]) < 0.3
    assert np.mean(blob["iou"]) == pytest.approx(10 / 11 * np.pi / 4, abs=0.03)  # the box of the disc as large
    assert np.mean(kcf["held"]) < 0.7
    assert np.mean(particles["held"][:5]) == 1
    assert len(kcf["ms"]) == len(particles["ms"]) == 11


def test_use_before_the_first_box_is_named() -> None:
    image = np.zeros((48, 64, 3), np.uint8)
    for tracker in (image_tracker("CSRT"), image_tracker("CamShift"), HueBlob(0.0), ParticleTracker(9, 0)):
        with pytest.raises(ValueError, match="before start"):
            tracker.step(image)
    with pytest.raises(ValueError, match=r"Boosting.*CSRT"):
        image_tracker("Boosting")  # type: ignore[arg-type]
