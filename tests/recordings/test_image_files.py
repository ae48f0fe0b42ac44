"""Every kind of picture comes as RGB uint8; any other file is named."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pps_vision.recordings.image_file import ImageFile, decode, number_in
from pps_vision.recordings.warnings import Problem, ProblemKind

RNG = np.random.default_rng(0)
COLOR = RNG.integers(0, 256, (6, 8, 3), dtype=np.uint8)


def write(file: Path, pixels: np.ndarray) -> ImageFile:
    assert cv2.imwrite(str(file), pixels)
    return ImageFile(file, 0.0)


def test_colours_are_rgb(tmp_path):
    for suffix in ("ppm", "png", "bmp"):
        np.testing.assert_array_equal(decode(write(tmp_path / f"a.{suffix}", COLOR[..., ::-1])), COLOR)
    # by hand, without OpenCV: a PPM's bytes are red, green, blue
    (tmp_path / "b.ppm").write_bytes(b"P6 1 1 255\n\x01\x02\x03")
    np.testing.assert_array_equal(decode(ImageFile(tmp_path / "b.ppm", 0)), [[[1, 2, 3]]])


def test_grey_is_replicated_alpha_dropped_and_16_bits_cut(tmp_path):
    grey = COLOR[..., 0]
    as_rgb = np.repeat(grey[..., None], 3, axis=2)
    np.testing.assert_array_equal(decode(write(tmp_path / "grey.png", grey)), as_rgb)
    np.testing.assert_array_equal(decode(write(tmp_path / "deep.png", grey.astype(np.uint16) * 256)), as_rgb)
    alpha = np.dstack([COLOR[..., ::-1], np.full((6, 8), 7, np.uint8)])
    np.testing.assert_array_equal(decode(write(tmp_path / "alpha.png", alpha)), COLOR)


@pytest.mark.parametrize("content", [b"", b"no picture", b"P6 8 6 255\n\x00\x01"], ids=["empty", "text", "cut"])
def test_what_is_no_picture_is_named(tmp_path, content):
    file = tmp_path / "a.ppm"
    file.write_bytes(content)
    problem = decode(ImageFile(file, 0.0, log=tmp_path / "data.log", line=7))
    assert isinstance(problem, Problem)
    assert (problem.kind, problem.line) == (ProblemKind.IMAGE, 7)
    assert str(problem).endswith("data.log:7: a.ppm cannot be decoded; expected an image")


@pytest.mark.parametrize("name", ["none.ppm", "zero\x00byte.ppm", "x" * 400])
def test_what_cannot_be_opened_is_named(tmp_path, name):
    problem = decode(ImageFile(tmp_path / name, 0.0))
    assert isinstance(problem, Problem)
    assert "cannot be opened" in problem.message


def test_the_last_number_of_a_name():
    names = {"1L05.jpg": 5, "cam0_frame0012.png": 12, "00000796.ppm": 796, "left.png": None, "a7.mp4": 7}
    assert {name: number_in(Path(name)) for name in names} == names
    assert number_in(Path(f"{'9' * 40}.png")) < 2**63, "tables hold it as 64 bits"
