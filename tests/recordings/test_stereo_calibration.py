"""Calibrations as OpenCV's samples write them."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibrations import store

from pps_vision.errors import InputError
from pps_vision.recordings import CalibrationOptions
from pps_vision.recordings.stereo_calibration import read_stereo_calibration

SIZE = (640, 480)
K1 = np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]])
K2 = np.array([[520.0, 0, 310], [0, 530, 250], [0, 0, 1]])
D1 = np.array([[-0.3, 0.1, 0.001, 0.002, 0.05]])
D2 = np.array([[-0.2, 0.05, 0.003, 0.004]])
R = cv2.Rodrigues(np.array([0.01, -0.1, 0.02]))[0]
T = np.array([[-6.5], [0.1], [0.2]])
CENTIMETRE = 0.01


def stereo(file: Path, **changes: np.ndarray | None) -> Path:
    entries = {"K1": K1, "D1": D1, "K2": K2, "D2": D2, "R": R, "T": T} | changes
    return store(file, **{key: value for key, value in entries.items() if value is not None})


def check(paths: list[Path], unit_m: float = CENTIMETRE) -> None:
    """The cameras and the place of the right one, against the definition p_right = R p_left + T."""
    left, right, T_left_right = read_stereo_calibration(paths, SIZE, CalibrationOptions(unit_m=unit_m))
    np.testing.assert_allclose(left.K, K1)
    np.testing.assert_allclose(right.K, K2)
    np.testing.assert_allclose(left.distortion, D1[0])
    np.testing.assert_allclose(right.distortion, [*D2[0], 0])
    p_left = np.array([0.1, -0.2, 1.5])
    p_right = R @ p_left + CENTIMETRE * T[:, 0]
    np.testing.assert_allclose(T_left_right @ [*p_right, 1], [*p_left, 1], atol=1e-9)


@pytest.mark.parametrize("flags", [0, cv2.FILE_STORAGE_WRITE_BASE64])
@pytest.mark.parametrize("suffix", ["xml", "yml", "json"])
def test_one_file_with_everything(tmp_path, suffix, flags):
    check([store(tmp_path / f"a.{suffix}", flags, K1=K1, D1=D1, K2=K2, D2=D2, R=R, T=T)])


@pytest.mark.parametrize("data", [60 * "A", "A", "AAAA" * 20, "!!", ""])
def test_bad_base64_is_refused(tmp_path, data):
    """60 times A: OpenCV's own parser never returns."""
    file = stereo(tmp_path / "a.xml")
    words = '<data type_id="binary">' + data
    file.write_text(re.sub("<data>[^<]*", words, file.read_text(), count=1))
    with pytest.raises(InputError, match=r"a\.xml: K1 has \d+ numbers; expected 9"):
        read_stereo_calibration([file], SIZE)


@pytest.mark.parametrize(
    ("matrix", "distortion"), [("camera_matrix", "distortion_coefficients"), ("intrinsic", "distortion")]
)
def test_of_files_of_one_camera_the_first_is_the_left_one(tmp_path, matrix, distortion):
    first = store(tmp_path / "b.xml", **{matrix: K1, distortion: D1})
    second = store(tmp_path / "a.xml", **{matrix: K2, distortion: D2})
    check([first, second, store(tmp_path / "c.xml", R=R, T=T, F=np.eye(3))])
    check([store(tmp_path / "c.xml", R=R, T=T), first, second])


def test_how_images_of_another_size_come_from_those_of_the_calibration_is_asked(tmp_path):
    """Truth: a point of the large image at pixel (u, v)."""
    sized = stereo(tmp_path / "a.yml", image_width=1280, image_height=960)
    point = np.array([0.05, -0.03, 1.0])
    u, v = cv2.projectPoints(point, np.zeros(3), np.zeros(3), K1, D1)[0].ravel()
    message = r"a\.yml: calibrated for 1280×960 pixels, images are {}; expected {}"
    with pytest.raises(InputError, match=message.format("640×480", r"--scaled \(.*\) or --crop X Y")):
        read_stereo_calibration([sized], SIZE)
    scaled, _, _ = read_stereo_calibration([sized], SIZE, CalibrationOptions(scaled=True))
    np.testing.assert_allclose(scaled.project(point), [(u + 0.5) / 2 - 0.5, (v + 0.5) / 2 - 0.5])
    cropped, _, _ = read_stereo_calibration([sized], SIZE, CalibrationOptions(crop=(100, 60)))
    np.testing.assert_allclose(cropped.project(point), [u - 100, v - 60])
    with pytest.raises(InputError, match=message.format("640×360", "--crop X Y")):
        read_stereo_calibration([sized], (640, 360))
    with pytest.raises(InputError, match=message.format("640×480", "--crop X Y of a part of the former")):
        read_stereo_calibration([sized], SIZE, CalibrationOptions(crop=(700, 0)))
    with pytest.raises(InputError, match=message.format("1280×1000", "images of the same camera")):
        read_stereo_calibration([sized], (1280, 1000))
    with pytest.raises(InputError, match=r"images are .*; expected no --crop, or the calibration of the whole images"):
        read_stereo_calibration([sized], None, CalibrationOptions(crop=(1, 0)))
    with pytest.raises(InputError, match="crop and scaled; expected one of them"):
        read_stereo_calibration([sized], SIZE, CalibrationOptions(crop=(0, 0), scaled=True))


TRAILING_ZEROS = np.array([[*D1[0], 0, 0, 0]])


def test_a_lens_model_that_the_file_states_is_not_asked(tmp_path):
    """The sample `calibration` writes fisheye_model."""
    four = {"D1": D1[:, :4] / 10, "D2": D2}
    left, right, _ = read_stereo_calibration([stereo(tmp_path / "a.yml", **four, fisheye_model=1)], SIZE)
    assert left.fisheye
    assert right.fisheye
    left, right, _ = read_stereo_calibration([stereo(tmp_path / "b.yml", **four, fisheye_model=0)], SIZE)
    assert not left.fisheye
    assert left.distortion == (*four["D1"][0].tolist(), 0.0)
    with pytest.raises(InputError, match="its lens model is radtan; expected no --lens fisheye"):
        read_stereo_calibration([tmp_path / "b.yml"], SIZE, CalibrationOptions(lens="fisheye"))


def test_trailing_zero_coefficients_are_none(tmp_path):
    check([stereo(tmp_path / "a.xml", D1=TRAILING_ZEROS)])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"T": None}, "no T; expected K1, D1, K2, D2, R and T"),
        ({"T": np.zeros((3, 1))}, "T is 0"),
        ({"R": None}, "no R; expected"),
        ({"R": 2 * R}, "R is .* expected a rotation matrix"),
        ({"R": -R}, "R is .* expected a rotation matrix"),
        ({"T": np.zeros((4, 1))}, "T is .*; expected 3 numbers"),
        ({"K2": None}, "no K2; expected"),
        ({"K1": np.diag([0.0, 500, 1])}, "K1 is .* with fx, fy > 0"),
        ({"K1": np.diag([500.0, 0, 1])}, "K1 is .* with fx, fy > 0"),
        ({"R": 1.0006 * R}, "R is .* expected a rotation matrix"),
        ({"K1": K1 + np.array([[0, 6e-4, 0], [0, 0, 0], [0, 0, 0]])}, "K1 is .* expected"),
        ({"K1": K1 + np.array([[0, 9.0, 0], [0, 0, 0], [0, 0, 0]])}, "K1 is .* expected"),
        ({"K1": K1 * np.nan}, "K1 is .*Nan.* expected 3×3 numbers"),
        ({"D1": np.ones((1, 15))}, "D1 has 15 coefficients; expected 14 or fewer of a radtan lens"),
        (
            {"D1": D1[:, :4]},
            "D1 holds 4 coefficients of a lens model that is not stated; expected --lens radtan",
        ),
        ({"image_width": 0, "image_height": 480}, "image_width 0.0, image_height 480.0; expected whole"),
        ({"image_width": 640.5, "image_height": 480}, "image_width 640.5, image_height 480.0; expected whole"),
        ({"K1": np.diag([1e300, 1e300, 1])}, r"K1 is .*1e\+300.*; expected 3×3 numbers"),
        ({"K2": K2 + np.array([[0, 0, 1e9], [0, 0, 0], [0, 0, 0]])}, r"K2 is .*1000000310.*; expected 3×3 numbers"),
        ({"D1": np.array([[-5.0, 0, 0, 0, 0]])}, r".*\(-5\.0.*; expected a camera whose pixels"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, changes, message):
    file = stereo(tmp_path / "stereo.xml", **changes)
    with pytest.raises(InputError, match=f"stereo.xml: {message}"):
        read_stereo_calibration([file], SIZE)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        (
            "a.xml",
            '<?xml version="1.0"?>\n<opencv_storage>\n<K1 type_id="opencv-matrix">\n<rows>3</rows>',
            r"a\.xml:4: ",
        ),
        ("a.yml", "%YAML:1.0\n---\nK1: [1, 2\n", r"a\.yml:\d+: cannot be parsed"),
        ("b.yml", "K1: [1, 2\n", r"b\.yml.*: cannot be parsed"),
        ("a.json", '{"K1": [[1, 2', r"a\.json:1: cannot be parsed"),
        (
            "c.yml",
            "%YAML:1.0\n---\nK1: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [1]\n",
            "no K2; expected K1, D1, K2, D2, R and T",
        ),
        ("d.yml", "%YAML:1.0\n---\nK1: unknown\n", r"d\.yml.*: "),
        ("e.yml", "%YAML:1.0\n---\nother: 1\n", "holds no calibration"),
        ("f.yml", "", r"f\.yml: cannot be parsed"),
        ("h.yml", "- 1\n- 2\n", r"h\.yml"),
        ("g.xml", "\x00\x01 not a calibration", r"g\.xml"),
    ],
)
def test_a_file_that_is_no_calibration_is_named(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_stereo_calibration([tmp_path / name], SIZE)
    assert len(str(caught.value).splitlines()) == 1


def test_a_missing_file_and_too_many_cameras_are_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.xml: cannot be read: No such file"):
        read_stereo_calibration([tmp_path / "none.xml"], SIZE)
    files = [store(tmp_path / f"{name}.xml", camera_matrix=K1) for name in "abc"]
    with pytest.raises(InputError, match=r"c\.xml: is one camera more than two"):
        read_stereo_calibration(files, SIZE)


def test_no_file_or_no_unit_is_refused(tmp_path):
    with pytest.raises(InputError, match="no file; expected a calibration"):
        read_stereo_calibration([], SIZE)
    for unit_m in (0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match=f"unit_m {unit_m}"):
            read_stereo_calibration([stereo(tmp_path / "a.xml")], SIZE, CalibrationOptions(unit_m=unit_m))


def test_a_long_file_is_read_up_to_a_limit(tmp_path):
    file = stereo(tmp_path / "a.yml")
    text = file.read_text()
    file.write_text(text + "more:\n" + "   - 1\n" * 1500)
    check([file])
    file.write_text(text + "# " + "x" * (2**22 - len(text)))
    with pytest.raises(InputError, match=r"a\.yml: has more than 4194304 characters or 2000 nodes"):
        read_stereo_calibration([file], SIZE)
