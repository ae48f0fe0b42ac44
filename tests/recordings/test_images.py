"""Image sequences without a log."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.formats.stereo_images import open_stereo_images
from pps_vision.recordings.image_file import natural_order
from pps_vision.recordings.video import open_frames
from pps_vision.recordings.warnings import ProblemKind


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
        open_stereo_images(*stereo(tmp_path, [1, 2], [3, 4]), fps=10)
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


def test_a_number_that_comes_twice_is_refused(tmp_path):
    _, right = stereo(tmp_path, [1], [1])
    write(tmp_path / "2L1.png", 0)
    with pytest.raises(InputError, match=r"2L1\.png: number 1 again"):
        open_stereo_images([str(tmp_path / "*L1.png")], right, fps=10)


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
