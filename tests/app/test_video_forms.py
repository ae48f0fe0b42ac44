"""Videos as cameras and programs write them, tracked by the command: the ball is where it was filmed.

Undisturbed the median error is 0.8 mm.
"""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from data import shared_data
from filmed import SCENE, calibration, film, track_error_mm, write_video, write_videos

from pps_vision.app.cli import main
from pps_vision.experiments.films.caster import PHOTOS
from pps_vision.recordings.open import open_recording

RIGHT_MM = 3.0
BESIDE = ("lr", "rl")


def turned(quarters: int) -> dict[str, Any]:
    """Images as a camera lying on its side records them, with the turn in the header that shows them upright."""
    return {
        "change": lambda image: np.rot90(image, -quarters),
        "set_up": lambda stream: stream.set_display_rotation(90 * quarters),
    }


@pytest.mark.parametrize(
    ("quarters", "said"),
    [
        (1, "90° anticlockwise"),
        *(pytest.param(*turn, marks=pytest.mark.long) for turn in ((2, "180°"), (3, "90° clockwise"))),
    ],
)
def test_images_are_turned_as_the_header_says(tmp_path, capsys, quarters, said):
    shown, words = write_videos(tmp_path, **turned(quarters))
    assert track_error_mm(words, shown, tmp_path / "out") < RIGHT_MM
    main(["info", *words])
    assert f"left.mp4: images are turned by {said}, as its header says (--no-rotate: as recorded)\n" in (
        capsys.readouterr().out
    )
    image = cv2.VideoCapture(words[3]).read()[1]  # OpenCV turns them too
    mine = open_recording(left=words[3], right=words[5]).pairs[0][0].load()
    np.testing.assert_allclose(mine.astype(float), image[..., ::-1], atol=3)


def test_no_rotate_takes_them_as_recorded(tmp_path, refused):
    _, words = write_videos(tmp_path, **turned(1))
    line = refused("info", *words[2:], "--calib", calibration(tmp_path / "c.yml", film()[0], (240, 320)))
    assert "calibrated for 240×320 pixels, images are 320×240" in line
    assert "left.mp4 is turned as its header says; --no-rotate takes it as it was recorded" in line
    recording = open_recording(left=words[3], right=words[5], calib=tmp_path / "c.yml", no_rotate=True)
    assert recording.image_size == (240, 320)
    np.testing.assert_allclose(recording.pairs[0][0].load(), np.rot90(film()[1][0][0], -1), atol=12)


@pytest.mark.parametrize("first", [0, pytest.param(1, marks=pytest.mark.long)])
def test_fields_of_an_interlaced_video_have_stamps_of_their_own(tmp_path, capsys, first):
    """Rows from `first` on, every second one, are of the frame's stamp, the others of 20 ms later."""
    shown, sides = film(scene=replace(SCENE, fps=50.0, seconds=0.8))
    words = ["--calib", calibration(tmp_path / "calib.yml", shown)]

    def interlace(stream: av.VideoStream) -> None:
        stream.codec_context.flags |= av.codec.context.Flags.interlaced_dct
        stream.codec_context.options = {"qp": "4", "x264-params": f"{'tb'[first]}ff=1"}

    for side, images in zip(("left", "right"), sides, strict=True):
        woven = [image.copy() for image in images[::2]]
        for image, later in zip(woven, images[1::2], strict=True):
            image[1 - first :: 2] = later[1 - first :: 2]
        words += [f"--{side}", write_video(tmp_path / f"{side}.mkv", woven, set_up=interlace)]
    assert track_error_mm(words, shown, tmp_path / "out") < RIGHT_MM
    main(["info", *map(str, words)])
    said = capsys.readouterr().out
    assert "40 pairs of 320×240 pixels, 0.78 s at 50 pairs/s" in said
    assert "left.mkv: interlaced; each frame is read as two fields" in said
    assert "every second row" not in said


def test_interlaced_images_are_told_where_the_file_does_not_say_so(tmp_path, capsys):
    shared_data(PHOTOS[0])  # procedural walls show no combed rows
    shown, sides = film(scene=replace(SCENE, fps=50.0))
    words = ["--calib", calibration(tmp_path / "calib.yml", shown)]
    for side, images in zip(("left", "right"), sides, strict=True):
        woven = [image.copy() for image in images[::2]]
        for image, later in zip(woven, images[1::2], strict=True):
            image[1::2] = later[1::2]
        words += [f"--{side}", write_video(tmp_path / f"{side}.mp4", woven)]
    main(["info", *map(str, words)])
    assert "try a video without interlacing (ffmpeg -i FILE -vf bwdif OUT): every second row" in capsys.readouterr().out


def _first_stamp(words: list) -> float:
    return open_recording(left=words[3], right=words[5]).pairs[0][0].stamp_s


def narrowed(image: np.ndarray) -> np.ndarray:
    return cv2.resize(image, (240, 240), interpolation=cv2.INTER_AREA)


def test_a_calibration_is_scaled_to_pixels_that_are_not_square(tmp_path, capsys):
    def set_up(stream: av.VideoStream) -> None:
        stream.codec_context.sample_aspect_ratio = Fraction(4, 3)

    shown, words = write_videos(tmp_path, change=narrowed, set_up=set_up)
    assert track_error_mm(words, shown, tmp_path / "out") < RIGHT_MM
    main(["info", *words])
    assert "left.mp4: pixels are 1.333 times as wide as high by its header" in capsys.readouterr().out


@pytest.mark.parametrize("layout", ["lr", "rl", "tb", "bt"])
@pytest.mark.parametrize("squeezed", [False, True])
def test_both_images_in_one_video(tmp_path, layout, squeezed):
    """Each is the image that was filmed; squeezed ones are tracked, with their cameras."""
    shown, sides = film()
    axis = int(layout in BESIDE)
    order = sides if layout in ("lr", "tb") else sides[::-1]
    size = (160, 240) if axis else (320, 120)
    images = [
        np.concatenate([cv2.resize(i, size, interpolation=cv2.INTER_AREA) if squeezed else i for i in pair], axis)
        for pair in zip(*order, strict=True)
    ]
    video = write_video(tmp_path / "both.mp4", images if layout in ("rl", "tb") else images[:2])
    calib = calibration(tmp_path / "calib.yml", shown)
    recording = open_recording(video, calib=calib, layout=layout, squeezed=squeezed)
    for file, side in zip(recording.pairs[0], sides, strict=True):
        expected = cv2.resize(side[0], size, interpolation=cv2.INTER_AREA) if squeezed else side[0]
        np.testing.assert_allclose(file.load().astype(float), expected, atol=12)
    if squeezed and layout in ("rl", "tb"):
        words = [video, "--calib", calib, "--layout", layout, "--squeezed"]
        assert track_error_mm(words, shown, tmp_path / "out") < 2 * RIGHT_MM


@pytest.mark.parametrize(("layout", "squeezed"), [("lr", False), ("bt", True)])
def test_both_views_in_each_image_of_a_folder(tmp_path, layout, squeezed):
    shown, sides = film()
    (tmp_path / "both").mkdir()
    for k, (left, right) in enumerate(zip(*sides, strict=True)):
        image = np.hstack([left, right]) if layout == "lr" else np.vstack([right, left])[::2]
        cv2.imwrite(str(tmp_path / "both" / f"{k}.png"), image[..., ::-1])
    words = [tmp_path / "both", "--calib", calibration(tmp_path / "calib.yml", shown), "--fps", 25, "--layout", layout]
    error_mm = track_error_mm([*words, *["--squeezed"] * squeezed], shown, tmp_path / "out")
    assert error_mm < RIGHT_MM * (1 + squeezed)


def test_squeezed_halves_are_proposed_for_a_whole_image(tmp_path, refused):
    shown, sides = film()
    pairs = (np.hstack([cv2.resize(i, (160, 240)) for i in pair]) for pair in zip(*sides, strict=True))
    video = write_video(tmp_path / "both.mp4", pairs)
    line = refused("info", video, "--calib", calibration(tmp_path / "calib.yml", shown))
    assert "--squeezed if each half is a whole image" in line


def test_files_of_one_camera_continue_each_other(tmp_path):
    shown, sides = film()
    words = ["--calib", calibration(tmp_path / "calib.yml", shown)]
    for side, images in zip(("left", "right"), sides, strict=True):
        names = [
            write_video(tmp_path / f"{side}{k}.mp4", part) for k, part in enumerate((images[:20], images[20:]), start=9)
        ]
        words += [f"--{side}", *names] if side == "left" else ["--right", tmp_path / "right*.mp4"]
    assert track_error_mm(words, shown, tmp_path / "out") < RIGHT_MM
    recording = open_recording(left=words[3:5], right=words[6])
    np.testing.assert_allclose([left.stamp_s for left, _ in recording.pairs], np.arange(40) / 25, atol=1e-6)
    assert [number for number, _ in recording.numbered()] == [*range(40)]


@pytest.mark.parametrize(
    ("suffix", "options"), [("mts", ()), pytest.param("3gp", (), marks=pytest.mark.long), ("h264", ("--fps", "25"))]
)
def test_files_of_cameras(tmp_path, refused, suffix, options):
    shown, words = write_videos(tmp_path, suffix)
    start_s = 0.0 if options else _first_stamp(words)
    if options:
        assert "left.h264: not every frame has a stamp of its own; expected --fps" in refused("info", *words)
    assert track_error_mm([*words, *options], shown, tmp_path / "out", start_s) < RIGHT_MM


def test_a_layout_needs_an_even_side(tmp_path, refused):
    write_video(tmp_path / "both.mp4", [np.zeros((121, 160, 3), np.uint8)] * 3)
    line = refused("info", Path(tmp_path / "both.mp4"), "--layout", "tb")
    assert "is 121 pixels high; expected two halves of one size (--layout)" in line


@pytest.mark.parametrize("stated", [True, False])
def test_cameras_with_images_of_unlike_sizes(tmp_path, capsys, stated):
    """The right camera's images are half as large, of other proportions, and it records three frames for two."""
    shown, sides = film(scene=replace(SCENE, fps=75.0, seconds=0.8))
    halved = [cv2.resize(image, (160, 120), interpolation=cv2.INTER_AREA)[10:] for image in sides[1]]
    left = write_video(tmp_path / "left.mp4", sides[0][::3])
    right = write_video(tmp_path / "right.mp4", halved[::2], 37.5)
    K2 = shown.rig.right.reduced(2).K
    K2[1, 2] -= 10
    sizes = {"image_width1": 320, "image_height1": 240, "image_width2": 160, "image_height2": 110} if stated else {}
    calib = calibration(tmp_path / "calib.yml", shown, None, K2=K2, **sizes)
    words = ["--left", left, "--right", right, "--calib", calib]
    assert track_error_mm([*words, "--video"], shown, tmp_path / "out") < 3 * RIGHT_MM
    main(["info", *map(str, words)])
    assert "pairs of 320×240 and 160×110 pixels" in capsys.readouterr().out
