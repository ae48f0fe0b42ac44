"""Image folders with stamps, and folders in EuRoC's and KITTI's layout, against the written content."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from calibrations import write_calibration

from pps_vision.errors import InputError
from pps_vision.recordings import CalibrationOptions
from pps_vision.recordings.formats.stereo_images import open_stereo_images
from pps_vision.recordings.open import open_recording
from pps_vision.recordings.recording import Recording
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.recordings.times import read_times
from pps_vision.recordings.warnings import ProblemKind

NS = [1403636579763555584 + 50_000_000 * k for k in range(4)]


def write(folder: Path, names: list[str], first: int = 0) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for k, name in enumerate(names):
        assert cv2.imwrite(str(folder / name), np.full((6, 8, 3), first + k, np.uint8))


def own(folder: Path, left: list[str], right: list[str], times: str | None = None) -> Recording:
    write(folder / "left", left)
    write(folder / "right", right, 100)
    if times is not None:
        (folder / "times.txt").write_text(times)
    return open_stereo_images(
        [str(folder / "left")],
        [str(folder / "right")],
        times=(read_times(folder / "times.txt"),) * 2 if times else (None, None),
    )


def test_folders_of_stamps_pair_by_them(tmp_path):
    left, right = ([f"{t + shift}.png" for t in NS] for shift in (0, 3_000_000))
    recording = own(tmp_path, left, [right[0], *right[2:]])
    np.testing.assert_allclose([f.stamp_left_s for f in recording], [NS[k] / 10**9 for k in (0, 2, 3)], atol=1e-6)
    np.testing.assert_allclose([f.stamp_right_s - f.stamp_left_s for f in recording], 0.003, atol=1e-6)
    assert [(f.left[0, 0, 0], f.right[0, 0, 0]) for f in recording] == [(0, 100), (2, 101), (3, 102)]
    assert [(p.kind, p.file.name) for p in recording.problems] == [(ProblemKind.UNPAIRED, left[1])]


def test_a_rate_that_replaces_stamps_in_names_is_told(tmp_path):
    sides = [[str(tmp_path / side)] for side in ("left", "right")]
    for (folder,) in sides:
        write(Path(folder), [f"{t}.png" for t in NS])
    assert open_stereo_images(*sides, fps=20).warnings == ()
    assert open_stereo_images(*sides, fps=30).warnings == ("--fps 30 replaces the files' own 20.00",)


@pytest.mark.parametrize(
    "times",
    ["0.5\n0.75\n# note\n\n2\n", "0.5 left/b2.png\n0.75 b10.png\n2 b11.png\n", "0.5,b2.png\n0.75,b10.png\n2,b11.png\n"],
)
def test_a_file_of_stamps(tmp_path, times):
    names = ["b2.png", "b10.png", "b11.png"]
    assert [f.stamp_left_s for f in own(tmp_path, names, names, times)] == [0.5, 0.75, 2]


@pytest.mark.parametrize("unit", [1, 1000, 1_000_000])
def test_stamps_in_digits_are_ns_us_or_ms_and_a_third_word_is_none(tmp_path, unit):
    names = ["1.png", "2.png"]
    rows = "".join(f"{t // 10**6 * 10**6 // unit} {name} rgb\n" for t, name in zip(NS, names, strict=False))
    stamps = [f.stamp_left_s for f in own(tmp_path, names, names, rows)]
    np.testing.assert_allclose(stamps, [1403636579.763, 1403636579.813], atol=1e-6)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ("1\n2\n", r"2 stamps for 3 images of .*left; expected one for each"),
        ("1\n1\n2\n", r"times\.txt:2: 1 after 1;"),
        ("1\nx\n2\n", r"times\.txt:2: "),
        ("1\nnan\n2\n", r"times\.txt:2: 'nan' is not finite"),
        ("1 a.png\n2\n", "2 stamps, 1 names"),
        ("# none\n", "0 stamps"),
    ],
)
def test_a_bad_file_of_stamps_is_named(tmp_path, times, message):
    names = ["1.png", "2.png", "3.png"]
    with pytest.raises(InputError, match=message):
        own(tmp_path, names, names, times)


def test_an_image_without_a_row_is_noted(tmp_path):
    recording = own(tmp_path, ["1.png", "2.png"], ["1.png", "2.png"], "7 1.png\n")
    assert [f.stamp_left_s for f in recording] == [7]
    assert [p.kind for p in recording.problems] == [ProblemKind.STAMP] * 2


SENSOR = (
    "sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, {},\n    0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
    "resolution: [8, 6]\ncamera_model: pinhole\nintrinsics: [10.0, 10.0, 4.0, 3.0]\n"
    "distortion_model: radial-tangential\ndistortion_coefficients: [0.0, 0.0, 0.0, 0.0]\n"
)


@pytest.mark.parametrize("place", ["mav0", "."])
def test_euroc(tmp_path, place):
    for k in range(2):
        camera = tmp_path / place / f"cam{k}"
        write(camera / "data", [f"{t}.png" for t in NS], 100 * k)
        rows = "".join(f"{t},{t}.png\r\n" for t in NS)
        (camera / "data.csv").write_bytes(f"#timestamp [ns],filename\r\n{rows}".encode())
        (camera / "sensor.yaml").write_text(SENSOR.format(0.11 * k))
    (tmp_path / place / "cam1" / "data" / f"{NS[1]}.png").unlink()
    recording = open_recording(tmp_path)
    assert [f.stamp_left_s for f in recording] == [NS[k] / 10**9 for k in (0, 2, 3)]
    assert [(f.left[0, 0, 0], f.right[0, 0, 0]) for f in recording] == [(0, 100), (2, 102), (3, 103)]
    assert recording.rig is not None
    np.testing.assert_allclose(recording.rig.view().right.center, [0.11, 0, 0], atol=1e-12)
    assert [p.file.name for p in recording.problems] == [f"{NS[1]}.png"]
    assert recording.warnings == ()
    unused = open_recording(tmp_path, fps=30, times=tmp_path / "times.txt").warnings
    assert unused == (f"--fps and --times not used: {tmp_path} has stamps of its own",)
    for option in ({"joints": tmp_path}, {"taxels": tmp_path}):
        with pytest.raises(InputError, match="expected it with an iCub's folder"):
            open_recording(tmp_path, **option)
    (tmp_path / place / "cam1" / "data.csv").rename(tmp_path / "rows.csv")
    with pytest.raises(InputError, match=r"cam1: no data\.csv; expected both cameras, cam0 and cam1, with a data\.csv"):
        open_recording(tmp_path)
    (tmp_path / "rows.csv").rename(tmp_path / place / "cam1" / "data.csv")
    sensor = tmp_path / place / "cam1" / "sensor.yaml"
    sensor.unlink()
    bare = open_recording(tmp_path)
    assert (bare.rig, len(bare), bare.calibration_at) == (None, 4, f"{sensor}, or two by --calib")


@pytest.mark.parametrize("colour", [False, True])
def test_kitti(tmp_path, colour):
    for k in range(4 if colour else 2):
        write(tmp_path / f"image_{k}", ["000000.png", "000001.png"], 50 * k)
    rows = [f"P{k}: 10 0 4 {-10 * baseline} 0 10 3 0 0 0 1 0\n" for k, baseline in enumerate((0, 0.5, 0.06, 0.66))]
    (tmp_path / "calib.txt").write_text("".join(rows) + "Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n")
    first_two = CalibrationOptions(cameras=("image_0", "image_1"))
    _, _, T_first_second = read_stereo_calibration([tmp_path / "calib.txt"], (8, 6), first_two)
    np.testing.assert_allclose(T_first_second[:3, 3], [0.5, 0, 0], atol=1e-12)
    (tmp_path / "times.txt").write_text("0.000000e+00\n1.037359e-01\n")
    recording = open_recording(tmp_path)
    assert [f.stamp_left_s for f in recording] == [0, 0.1037359]
    assert next(iter(recording)).right[0, 0, 0] == (150 if colour else 50)
    assert recording.rig is not None
    np.testing.assert_allclose(recording.rig.view().right.center, [0.6 if colour else 0.5, 0, 0], atol=1e-12)
    assert open_recording(tmp_path, fps=30).warnings == (f"--fps 30 replaces the stamps of {tmp_path / 'times.txt'}",)
    with pytest.raises(InputError, match="fps and times; expected one of them"):
        open_recording(tmp_path, fps=10, times=tmp_path / "times.txt")
    (tmp_path / "times.txt").unlink()
    with pytest.raises(InputError, match=r"times\.txt: cannot be read"):
        open_recording(tmp_path)
    np.testing.assert_allclose([f.stamp_left_s for f in open_recording(tmp_path, fps=10)], [0, 0.1])
    (tmp_path / "calib.txt").unlink()
    bare = open_recording(tmp_path, fps=10)
    assert (bare.rig, bare.calibration_at) == (None, f"{tmp_path / 'calib.txt'}, or one by --calib")
    (tmp_path / "image_1").rename(tmp_path / "other")
    if colour:
        (tmp_path / "image_3").rename(tmp_path / "another")
    with pytest.raises(InputError, match="images of one camera only; expected image_2 and image_3, or image_0 and"):
        open_recording(tmp_path)


def test_a_rate_is_positive(tmp_path):
    write(tmp_path / "left", ["1.png"])
    write(tmp_path / "right", ["1.png"])
    calib = [write_calibration(tmp_path / "calib.yml", 5.0, (4.0, 3.0))]
    sides = {side: [str(tmp_path / side)] for side in ("left", "right")} | {"calib": calib}
    for fps in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match=r"fps .*; expected a positive number of frames a second"):
            open_recording(**sides, fps=fps)
    assert len(open_recording(**sides, fps=0.5)) == 1
