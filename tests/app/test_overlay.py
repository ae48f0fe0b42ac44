"""Overlays: the cross is at its pixel at every magnification."""

from pathlib import Path

import av
import numpy as np
import pytest
from tracks import track_at

from pps_vision.app.report.overlay import VideoFile, draw_pair
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.types import Detection2D, Status, StereoFrame, Track3D

TEXT_ROWS = 30
CAMERA = Camera(100, 100, 100.0, 100.0, 49.5, 49.5)
VIEW = StereoRig.fixed(CAMERA, CAMERA, np.eye(4)).view()
FRAME = StereoFrame(*np.zeros((2, 100, 100, 3), np.uint8), 0.0, 0.0)


@pytest.mark.parametrize(("pixel", "scale"), [((40.0, 60.0), 1), ((40.5, 60.25), 2), ((47.75, 71.5), 5)])
def test_the_cross_is_centred_on_the_projected_position(pixel: tuple[float, float], scale: int) -> None:
    """Pixel u of the image covers the pixels from scale * u to scale * u + scale - 1 of the canvas."""
    track = track_at([(pixel[0] - 49.5) / 100, (pixel[1] - 49.5) / 100, 1.0])
    drawn = draw_pair(FRAME, VIEW, track, scale=scale)
    light = drawn[TEXT_ROWS:, : 100 * scale].sum(axis=2, dtype=float)
    rows, columns = np.nonzero(light)
    centre = np.average(columns, weights=light[rows, columns]), np.average(rows, weights=light[rows, columns])
    wanted = [scale * (value + 0.5) - 0.5 for value in pixel]
    np.testing.assert_allclose(centre, [wanted[0], wanted[1] - TEXT_ROWS], atol=0.15)
    assert [np.ptp(columns), np.ptp(rows)] == pytest.approx([7 * scale] * 2, abs=2)  # arms of 3.5 px


def test_a_detection_is_a_ring_of_its_angular_size_in_the_colour_of_the_status() -> None:
    """In the image of its eye: 100 px times the tangent of its angular radius, twice enlarged."""
    detection = Detection2D(0.0, "right", np.array([50.0, 60.0]), np.eye(2), 0.9, np.arctan(0.2), (40, 50, 20, 20))
    drawn = draw_pair(FRAME, VIEW, Track3D.unknown(0.0, Status.COASTING), [detection])
    left, right = np.split(drawn[TEXT_ROWS:].astype(float), 2, axis=1)
    assert not left.any()
    rows, columns = np.nonzero(right.sum(axis=2) > 300)
    distance = np.hypot(columns - 100.5, rows + TEXT_ROWS - 120.5)
    assert distance.mean() == pytest.approx(40, abs=0.5)
    assert np.ptp(distance) < 4
    strongest = right.reshape(-1, 3)[right.sum(axis=2).argmax()]
    np.testing.assert_allclose(strongest, (250, 190, 40), atol=2)


def test_only_taxels_in_view_are_drawn_the_larger_the_likelier() -> None:
    taxels = np.array([[-0.2, 0.0, 1.0], [0.2, 0.0, 1.0], [0.0, 0.2, -1.0], [0.7, 0.0, 1.0]])
    pair = draw_pair(FRAME, VIEW, Track3D.unknown(0.0), (), taxels, np.array([0.01, 0.99, 0.9, 0.9]))
    lit = pair[TEXT_ROWS:, :200].any(axis=2)
    assert 0 < lit[:, :100].sum() < 0.3 * lit[:, 100:].sum()
    assert not lit[:, 160:].any()
    areas = [pair[TEXT_ROWS:, k : k + 100].max(axis=2).sum() / top for k, top in ((0, 170), (100, 255))]
    assert areas == pytest.approx([np.pi * (2 * (1.2 + 3 * a)) ** 2 for a in (0.01, 0.99)], rel=0.25)


def test_a_film_holds_every_image_cut_to_even_sides_and_without_an_image_is_no_file(tmp_path: Path) -> None:
    with VideoFile(tmp_path / "a.mp4", 20.0) as film, VideoFile(tmp_path / "b.mp4", 20.0):
        for level in (40, 120, 200):
            film.add(np.full((31, 43, 3), level, np.uint8))
    assert [file.name for file in tmp_path.iterdir()] == ["a.mp4"]
    with av.open(str(tmp_path / "a.mp4")) as read:
        assert read.streams.video[0].average_rate == 20
        images = [frame.to_ndarray(format="rgb24") for frame in read.decode(video=0)]
    assert [image.shape for image in images] == [(30, 42, 3)] * 3
    np.testing.assert_allclose([image.mean() for image in images], (40, 120, 200), atol=3)
