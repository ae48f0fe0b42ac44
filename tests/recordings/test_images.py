"""Image files, and sequences of them without a log."""

from pathlib import Path

import cv2
import numpy as np
import PIL.Image
import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.formats.stereo_images import open_stereo_images
from pps_vision.recordings.image_file import ImageFile, decode, natural_order, number_in
from pps_vision.recordings.times import read_times
from pps_vision.recordings.video import open_frames
from pps_vision.recordings.warnings import Problem, ProblemKind


def write(file: Path, value: int, size: tuple[int, int] = (8, 6)) -> None:
    file.parent.mkdir(exist_ok=True)
    assert cv2.imwrite(str(file), np.full((size[1], size[0], 3), value, np.uint8))


def stereo(folder: Path, left: list[int], right: list[int]) -> tuple[list[str], list[str]]:
    for side, numbers in (("L", left), ("R", right)):
        for number in numbers:
            write(folder / f"1{side}{number}.png", number + (100 if side == "R" else 0))
    return [str(folder / "1L*.png")], [str(folder / "1R*.png")]


def test_pairs_go_by_number_in_natural_order(tmp_path):
    recording = open_stereo_images(*stereo(tmp_path, [9, 10, 11], [9, 10, 11]), fps=20)
    frames = list(recording.numbered())
    assert [number for number, _ in frames] == [9, 10, 11]
    assert [(f.left[0, 0, 0], f.right[0, 0, 0]) for _, f in frames] == [(9, 109), (10, 110), (11, 111)]
    np.testing.assert_allclose([f.stamp_s for _, f in frames], [0, 0.05, 0.1])
    assert (recording.image_size, recording.problems, len(recording)) == ((8, 6), [], 3)
    assert frames[0][1].joints_left_rad is None


def test_an_unpaired_image_is_named_and_leaves_a_gap_in_time(tmp_path):
    recording = open_stereo_images(*stereo(tmp_path, [10, 20, 40, 50], [10, 30, 40, 50]), fps=10)
    np.testing.assert_allclose([frame.stamp_s for frame in recording], [0, 0.3, 0.4])
    assert [problem.kind for problem in recording.problems] == [ProblemKind.UNPAIRED] * 2
    assert [problem.file.name for problem in recording.problems] == ["1L20.png", "1R30.png"]


def test_numbers_that_begin_apart_are_told(tmp_path):
    assert "end +1 from the left ones" in open_stereo_images(*stereo(tmp_path, [0, 1], [1, 2]), fps=20).warnings[0]
    with pytest.raises(InputError, match=r"1R9.png: no image of the number of a left one; .* end \+9 from"):
        open_stereo_images(*stereo(tmp_path / "far", [0, 1], [9, 10]), fps=20)


def test_a_bad_image_is_named_once_and_its_pair_skipped(tmp_path):
    patterns = stereo(tmp_path, [1, 2, 3], [1, 2, 3])
    (tmp_path / "1R1.png").write_bytes(b"")
    (tmp_path / "1L3.png").write_bytes(b"no picture")
    recording = open_stereo_images(*patterns, fps=10)
    for _ in range(2):
        assert [number for number, _ in recording.numbered()] == [2]
    assert [(p.kind, p.file.name) for p in recording.problems] == [
        (ProblemKind.IMAGE, "1R1.png"),
        (ProblemKind.IMAGE, "1L3.png"),
    ]


def test_a_name_without_a_number_is_named(tmp_path):
    patterns = stereo(tmp_path, [1], [1])
    write(tmp_path / "L.png", 0)
    recording = open_stereo_images([str(tmp_path / "*L*.png")], patterns[1], fps=10)
    assert [(p.kind, p.file.name) for p in recording.problems] == [(ProblemKind.UNPAIRED, "L.png")]
    assert len(recording) == 1


@pytest.mark.parametrize("odd", ["1L1.png", "1R2.png"])
def test_an_image_of_another_size_is_left_out(tmp_path, odd):
    recording = open_stereo_images(*stereo(tmp_path, [1, 2, 3], [1, 2, 3]), fps=10)
    write(tmp_path / odd, 0, size=(4, 3))
    for _ in range(2):
        assert len(list(recording)) == 2
    (problem,) = recording.problems
    assert str(problem).endswith(f"{odd} is 4×3 pixels; expected 8×6 like the others")


def test_no_usable_pair_is_refused(tmp_path):
    with pytest.raises(InputError, match="no usable frame"):
        open_stereo_images(*stereo(tmp_path, [1, 2], [3, 5]), fps=10)
    with pytest.raises(InputError, match=r"x\*\.png: matches no file"):
        open_stereo_images([str(tmp_path / "x*.png")], [str(tmp_path / "1R*.png")], fps=10)
    gone = [str(tmp_path / f"gone{i}.png") for i in range(40)]
    with pytest.raises(InputError, match=r"gone0\.png \(and 39 more\): matches no file"):
        open_stereo_images(gone, [str(tmp_path / "1R*.png")], fps=10)


def test_files_that_are_given_twice_count_once(tmp_path, monkeypatch):
    left, right = stereo(tmp_path, [1, 2], [1, 2])
    monkeypatch.chdir(tmp_path)
    recording = open_stereo_images([*left, "1L1.png", *left], right * 2, fps=10)
    assert ([number for number, _ in recording.numbered()], recording.problems) == ([1, 2], [])
    assert recording.name == f"{left[0]} (and 2 more)"
    assert len(open_stereo_images(["1L1.png"], [str(Path("1R1.png").rename("1R[1].png"))], fps=10)) == 1


def test_a_number_that_comes_twice_is_refused(tmp_path):
    _, right = stereo(tmp_path, [1], [1])
    write(tmp_path / "1L01.png", 0)
    with pytest.raises(InputError, match=r"1L01\.png: number 1 again; expected each once, and .*1L1\.png has it"):
        open_stereo_images([str(tmp_path / "*L*.png")], right, fps=10)


@pytest.mark.parametrize("template", ["{n:04d}_cam{c}", "{n}-{c}", "rig2_{n:06d}_{c}_v3", "cam{c}_{n}"])
def test_the_number_of_a_name_is_not_that_of_its_camera(tmp_path, template):
    for n in (8, 9, 10):
        for camera in (1, 2):
            write(tmp_path / f"{template.format(n=n, c=camera)}.png", 10 * n + camera)
    left, right = ([str(tmp_path / f"{template.format(n=n, c=c)}.png") for n in (8, 9, 10)] for c in (1, 2))
    frames = list(open_stereo_images(left, right, fps=10).numbered())
    assert [number for number, _ in frames] == [8, 9, 10]
    assert [(f.left[0, 0, 0], f.right[0, 0, 0]) for _, f in frames] == [(81, 82), (91, 92), (101, 102)]


@pytest.mark.parametrize(
    ("names", "stamps_s"),
    [
        (("2024-05-17_14-30-05.900_left", "2024-05-17_14-30-06.000_left"), (1715956205.9, 1715956206.0)),
        (("L20240517T143005_900250", "L20240517T143006_000250"), (1715956205.90025, 1715956206.00025)),
        (("14-30-05-900", "14-30-06-000"), (52205.9, 52206.0)),
        (("1715956205900_cam0", "1715956206000_cam0"), (1715956205.9, 1715956206.0)),
        (("1715956205.900_l", "1715956206.000_l"), (1715956205.9, 1715956206.0)),
    ],
)
def test_names_with_the_time_of_a_clock_are_stamps(tmp_path, names, stamps_s):
    for side in "ab":
        for name in names:
            write(tmp_path / side / f"{name}.png", 9)
    recording = open_stereo_images([str(tmp_path / "a")], [str(tmp_path / "b")])
    np.testing.assert_allclose([left.stamp_s for left, _ in recording.pairs], stamps_s, atol=1e-6)
    assert recording.problems == []


@pytest.mark.parametrize(
    "name", ["99-99-99-123", "2024-13-45_10-00-00.000", "000012", "12-30-05", "20261122", "14036365797635"]
)
def test_names_without_a_time_are_no_stamps(tmp_path, name):
    for side in "ab":
        write(tmp_path / side / f"{name}.png", 9)
    with pytest.raises(InputError, match=r"its name is no stamp; expected --fps, --times, or stamps as names"):
        open_stereo_images([str(tmp_path / "a")], [str(tmp_path / "b")])


def ramp(bits: int, k: int, shifted: int = 0) -> np.ndarray:
    """Levels up to the highest of `bits`, in the uppermost or the lowest bits of 16."""
    levels = np.linspace(0, 2**bits - 1, 6 * 8).reshape(6, 8) * (1 - 0.25 * (k == 0))
    return np.repeat(levels.astype(np.uint16)[..., None] << shifted, 3, axis=2)


@pytest.mark.parametrize(("bits", "shifted"), [(10, 0), (12, 0), (14, 0), (16, 0), (12, 4)])
@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_the_highest_bit_in_use_is_the_highest_of_eight(tmp_path, bits, shifted, suffix):
    for side in "LR":
        for k in range(3):
            assert cv2.imwrite(str(tmp_path / f"{side}{k}.{suffix}"), ramp(bits, k, shifted))
    frames = list(open_stereo_images([str(tmp_path / "L*")], [str(tmp_path / "R*")], fps=10))
    for k, frame in enumerate(frames):  # of one scale, although the first is darker
        np.testing.assert_array_equal(frame.left, (ramp(bits, k) >> (bits - 8)).astype(np.uint8))
        np.testing.assert_array_equal(frame.left, frame.right)
    assert [image.max() for _, image in open_frames(tmp_path)] == [191, 255, 255] * 2


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_the_pages_of_a_stack_are_its_images(tmp_path, depth):
    """Red and blue are told apart; two files of one camera continue each other."""
    pages = [np.full((6, 8, 3), (10 * k, 0, 200), depth) for k in range(5)]
    for name, shown in (("L0", pages[:3]), ("L1", pages[3:]), ("R", pages)):
        assert cv2.imwritemulti(str(tmp_path / f"{name}.tif"), [page[..., ::-1] for page in shown])
    frames = list(open_stereo_images([str(tmp_path / "L*.tif")], [str(tmp_path / "R.tif")], fps=10).numbered())
    assert [number for number, _ in frames] == [*range(5)]
    for k, frame in frames:
        assert [tuple(image[0, 0]) for image in (frame.left, frame.right)] == [(10 * k, 0, 200)] * 2
        assert frame.stamp_s == pytest.approx(0.1 * k)
    (tmp_path / "times.txt").write_text("1\n2\n3\n4\n5.5\n")
    times = read_times(tmp_path / "times.txt")
    recording = open_stereo_images([str(tmp_path / "L*.tif")], [str(tmp_path / "R.tif")], times=(times, times))
    assert [left.stamp_s for left, _ in recording.pairs] == [1, 2, 3, 4, 5.5]
    with pytest.raises(InputError, match=r"is a stack without stamps; expected --fps, --times"):
        open_stereo_images([str(tmp_path / "L*.tif")], [str(tmp_path / "R.tif")])
    assert len(open_frames(tmp_path)) == 10


def test_that_an_orientation_is_ignored_is_said(tmp_path):
    for side in "LR":
        image = PIL.Image.new("RGB", (8, 6))
        exif = image.getexif()
        exif[274] = 6 if side == "L" else 1
        image.save(tmp_path / f"{side}1.jpg", exif=exif)
    recording = open_stereo_images([str(tmp_path / "L1.jpg")], [str(tmp_path / "R1.jpg")], fps=10)
    assert recording.notes == (f"{tmp_path / 'L1.jpg'}: its orientation (EXIF) is ignored: images are as recorded",)
    assert recording.image_size == (8, 6)
    assert open_stereo_images([str(tmp_path / "R1.jpg")], [str(tmp_path / "L1.jpg")], fps=10).notes == ()


def test_a_folder_of_frames_in_natural_order(tmp_path):
    for number in (1, 2, 10):
        write(tmp_path / f"f{number}.PNG", number)
    (tmp_path / "notes.txt").write_text("no frame")
    frames = open_frames(tmp_path)
    assert [(frame, image[0, 0, 0]) for frame, image in frames] == [(1, 1), (2, 2), (3, 10)]
    assert (len(frames), frames.image_size, frames.problems) == (3, (8, 6), [])


def test_stamps_of_nineteen_digits_are_compared_whole():
    names = ["1999999999999999999.png", "2000000000000000001.png", "0999999999999999999.png"]
    assert [path.stem[0] for path in sorted(map(Path, names), key=natural_order)] == ["0", "1", "2"]


RNG = np.random.default_rng(0)
COLOR = RNG.integers(0, 256, (6, 8, 3), dtype=np.uint8)


def written(file: Path, pixels: np.ndarray) -> ImageFile:
    assert cv2.imwrite(str(file), pixels)
    return ImageFile(file, 0.0)


def test_colours_are_rgb(tmp_path):
    for suffix in ("ppm", "png", "bmp"):
        np.testing.assert_array_equal(decode(written(tmp_path / f"a.{suffix}", COLOR[..., ::-1])), COLOR)
    # by hand, without OpenCV: a PPM's bytes are red, green, blue
    (tmp_path / "b.ppm").write_bytes(b"P6 1 1 255\n\x01\x02\x03")
    np.testing.assert_array_equal(decode(ImageFile(tmp_path / "b.ppm", 0)), [[[1, 2, 3]]])


def test_grey_is_replicated_alpha_dropped_and_16_bits_cut(tmp_path):
    grey = COLOR[..., 0]
    as_rgb = np.repeat(grey[..., None], 3, axis=2)
    np.testing.assert_array_equal(decode(written(tmp_path / "grey.png", grey)), as_rgb)
    np.testing.assert_array_equal(decode(written(tmp_path / "deep.png", grey.astype(np.uint16) * 256)), as_rgb)
    alpha = np.dstack([COLOR[..., ::-1], np.full((6, 8), 7, np.uint8)])
    np.testing.assert_array_equal(decode(written(tmp_path / "alpha.png", alpha)), COLOR)


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
