"""Overlays: the cross is at its pixel at every magnification."""

from dataclasses import replace

import av
import numpy as np
import pytest
from tracks import track_at

from pps_vision.app.report.overlay import VideoFile, draw_pair
from pps_vision.geometry.camera import Camera, StereoRig
from pps_vision.types import Detection2D, StereoFrame
from tracking.tracker import TrackerStep

TEXT_ROWS = 30


@pytest.mark.parametrize(("pixel", "side", "scale"), [((40.0, 60.0), 1000, 1), ((40.5, 60.25), 100, 2)])
def test_the_cross_is_centred_on_the_projected_position(pixel, side, scale):
    """Pixel u of a small image covers the pixels from scale * u to scale * u + scale - 1 of the canvas."""
    camera = Camera(side, side, 100.0, 100.0, 49.5, 49.5)
    view = StereoRig.fixed(camera, camera, np.eye(4)).view()
    track = track_at([(pixel[0] - 49.5) / 100, (pixel[1] - 49.5) / 100, 1.0])
    step = TrackerStep(track, (), None, np.zeros((2, 3)))
    drawn = draw_pair(StereoFrame(*np.zeros((2, side, side, 3), np.uint8), 0.0, 0.0), view, step)
    light = drawn[TEXT_ROWS : 100 * scale, : 100 * scale].sum(axis=2, dtype=float)
    rows, columns = np.nonzero(light)
    centre = np.average(columns, weights=light[rows, columns]), np.average(rows, weights=light[rows, columns])
    wanted = [scale * (value + 0.5) - 0.5 for value in pixel]
    np.testing.assert_allclose(centre, [wanted[0], wanted[1] - TEXT_ROWS], atol=0.15)
    assert [np.ptp(columns), np.ptp(rows)] == pytest.approx([7 * scale] * 2, abs=2)  # arms of 3.5 px


def test_each_track_has_its_colour_and_the_attended_one_a_thicker_ring():
    camera = Camera(1000, 1000, 1000.0, 1000.0, 499.5, 499.5)
    view = StereoRig.fixed(camera, camera, np.eye(4)).view()
    centers_px = np.array([300.0, 500.0]), np.array([700.0, 500.0])
    first, second = (
        TrackerStep(
            track_at((0, 0, 1), track_id=track_id),
            (Detection2D(0.0, "left", center_px, np.eye(2), 0.9, 0.1, (0, 0, 9, 9)),),
            *(None, np.zeros((2, 3))),
        )
        for track_id, center_px in enumerate(centers_px, start=1)
    )
    black = StereoFrame(*np.zeros((2, 1000, 1000, 3), np.uint8), 0.0, 0.0)
    for attended, other in ((first, second), (second, first)):
        drawn = draw_pair(black, view, replace(attended, others=(other,)))
        rings = [drawn[420:480, int(u) - 150 : int(u) + 150].astype(int) for u, _ in centers_px]
        lit = [int((ring.sum(axis=2) > 60).sum()) for ring in rings]
        assert (lit[0] > 1.3 * lit[1]) == (attended is first)
        assert (lit[1] > 1.3 * lit[0]) == (attended is second)
        hues = [ring.reshape(-1, 3)[ring.sum(axis=2).argmax()] for ring in rings]
        assert hues[0].argmax() == 1  # green
        assert hues[1].argmax() == 2  # blue


def test_a_film_holds_every_image_cut_to_even_sides_and_without_an_image_is_no_file(tmp_path):
    with VideoFile(tmp_path / "a.mp4", 20.0) as film, VideoFile(tmp_path / "b.mp4", 20.0):
        for level in (40, 120, 200):
            film.add(np.full((31, 43, 3), level, np.uint8))
    assert [file.name for file in tmp_path.iterdir()] == ["a.mp4"]
    with av.open(str(tmp_path / "a.mp4")) as read:
        assert read.streams.video[0].average_rate == 20
        images = [frame.to_ndarray(format="rgb24") for frame in read.decode(video=0)]
    assert [image.shape for image in images] == [(30, 42, 3)] * 3
    np.testing.assert_allclose([image.mean() for image in images], (40, 120, 200), atol=3)
