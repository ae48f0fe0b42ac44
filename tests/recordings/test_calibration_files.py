"""One stereo camera in the calibration of every tool, as its documentation says, and the iCub's own file."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from calibration_forms import CASES, FORMS, SIZE

from pps_vision.errors import InputError
from pps_vision.recordings import CalibrationOptions
from pps_vision.recordings.documents import parse_yaml
from pps_vision.recordings.icub_eyes import fit_to_images, read_icub_eyes, write_icub_eyes
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.robot.icub import LEFT_EYE, RIGHT_EYE


@pytest.mark.parametrize("form", CASES)
def test_positions_by_each_form_are_those_of_opencv_s_projections(tmp_path, form):
    """Points are projected by OpenCV; the calibration triangulates them within 1 µm, in the left camera's frame."""
    write, camera = CASES[form]
    assert camera.error_m(write(tmp_path)) < 1e-6


@pytest.mark.parametrize(("form", "name"), [("P{}: {}\n", "image_{}"), ("P_rect_0{}: {}\n", "image_0{}")])
def test_kitti(tmp_path, form, name):
    """The numbers of KITTI's odometry sequence 00: cameras 0 and 1 are 53.7 cm apart."""
    K = "718.856 0.0 607.1928 {} 0.0 718.856 185.2157 {} 0.0 0.0 1.0 {}"
    others = ("0.0 0.0 0.0", "-386.1448 0.0 0.0", "45.38225 -0.1130887 0.003779761", "-337.2877 2.369057 0.004915215")
    text = "".join(form.format(k, K.format(*words.split())) for k, words in enumerate(others))
    (tmp_path / "calib.txt").write_text(text + "Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n")
    with pytest.raises(InputError, match=r"holds 4 cameras, image_0.*; two are used; expected --cameras"):
        read_stereo_calibration([tmp_path / "calib.txt"], (1241, 376))
    names = [name.format(k) for k in range(4)]
    first = CalibrationOptions(cameras=(names[0], names[1]))
    left, right, T = read_stereo_calibration([tmp_path / "calib.txt"], (1241, 376), first)
    np.testing.assert_allclose(T[:3, 3], [386.1448 / 718.856, 0, 0])
    assert (left, left.fx, left.cx, left.distortion) == (right, 718.856, 607.1928, (0,) * 5)
    _, _, T = read_stereo_calibration(
        [tmp_path / "calib.txt"], (1241, 376), images=([f"{names[2]}/data"], [f"{names[3]}/data"])
    )
    places = [np.linalg.solve(left.K, np.array(words.split(), float)) for words in others[2:]]
    np.testing.assert_allclose(T[:3, 3], places[0] - places[1], atol=1e-9)


@pytest.mark.parametrize(
    ("form", "original", "instead", "message"),
    [
        ("kalibr", "cam1:", "cam1: 3\ncam2:", "cam1 is '3'; expected the entries of a camera"),
        ("kalibr", "cam1:", "cam2:", r"camchain\.yaml: no R; expected K1, .*, or two cameras with their poses"),
        ("kalibr", "intrinsics: [700.0", "intrinsics: [1.2e9", "intrinsics is .* expected 4 numbers"),
        ("kalibr", "cam0", "# " + "x" * 2**22 + "\ncam0", "more than 4194304 characters or 2000 nodes"),
        ("kalibr", "cam0", "#" + 200_000 * "[" + "\ncam0", "characters or 2000 nodes; expected a calibration"),
        ("kalibr", "radtan", "fov", "distortion_model fov; expected one of radtan"),
        ("kalibr", "camera_model: pinhole", "camera_model: omni", "camera_model omni; expected pinhole"),
        ("kalibr", "T_cn_cnm1", "T_cam_imu", "T_cn_cnm1 is None; expected 4×4 numbers"),
        ("euroc", "resolution: [1280, 720]", "resolution: [1280]", "resolution is .* expected 2 numbers"),
        ("euroc", "data: [", "data: [nan, ", "T_BS has 17 numbers; expected 16"),
        ("euroc", "rate_hz: 20", "rate_hz: &x 20", r"0\.yaml:12: cannot be parsed"),
        ("ros", "rows: 3\n", "rows: 3\n  rows: 3\n", "rows again"),
        ("anipose", "size", "[size", "cannot be parsed: .*line 5"),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path, form, original, instead, message):
    files = FORMS[form](tmp_path)
    files[0].write_text(files[0].read_text().replace(original, instead, 1))
    with pytest.raises(InputError, match=message):
        read_stereo_calibration(files, SIZE)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("P1:", "P0:", r"calib\.txt:2: cannot be parsed: P0 again"),
        ("P1:", "X:", r"holds 1 camera; expected two, or two files"),
        ("P0: 718.856", "P0: -718.856", r"projection .*; expected \[K \| K t\] with positive focal lengths"),
        ("P0: 718.856", "P0: 0", r"projection .*; expected \[K \| K t\] with positive focal lengths"),
        ("0 718.856 185", "0 0 185", r"projection .*; expected \[K \| K t\] with positive focal lengths"),
        ("P0: 718.856 0", "P0: 718.856 x", "P0 is .*; expected 3×4 numbers"),
    ],
)
def test_a_projection_that_is_none_is_named(tmp_path, old, new, message):
    row = "P{}: 718.856 0 607.1928 {} 0 718.856 185.2157 0 0 0 1 0\n"
    text = row.format(0, 0.0) + row.format(1, -386.1448)
    (tmp_path / "calib.txt").write_text(text)
    assert read_stereo_calibration([tmp_path / "calib.txt"], (1241, 376))[2][0, 3] > 0.5
    (tmp_path / "calib.txt").write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        read_stereo_calibration([tmp_path / "calib.txt"], (1241, 376))


YAML = """---
a: {rows: 3, data: [1, 2e-3, [x y, 'p, q']]}  # note
list:
- - -1
  - 1:30
-
  b: "c # d: e"
  f:
url: http://x/y:1
long: [1e-05,
  no]
"""


def test_yaml_scalars_stay_as_they_are_written():
    assert parse_yaml(Path("f"), YAML) == {
        "a": {"rows": "3", "data": ["1", "2e-3", ["x y", "p, q"]]},
        "list": [["-1", "1:30"], {"b": "c # d: e", "f": ""}],
        "url": "http://x/y:1",
        "long": ["1e-05", "no"],
    }
    assert parse_yaml(Path("f"), "# only a note\n\n") is None
    assert parse_yaml(Path("f"), "- " * 16 + "1") is not None


@pytest.mark.parametrize(
    ("text", "line"),
    [
        *(("a: [1", "[12]"), ("a: 1\n b: 2", 2), ("a: [b]]\n- [", 1), ("a:\n\tb: 1", 2), ("a: 'x", 1)),
        *(("a: *b", 1), ("a: 1\nb: &c 1", 2), ("- &c [1]\n- *c", 1), ("a: !!python/name:os.system x", 1)),
        *(("a: 1\na: 2", 2), ("a: {b: 1, b: 2}", 1), ("? [1, 2]\n: 3", 1), ("a: 1\n---\nb: 2", 2)),
        *(("- " * 17 + "1", 1), ("[" * 999, 1), ("a: 1\nb: \0", 2)),
    ],
)
def test_what_is_no_such_yaml_is_refused_with_its_line(text, line):
    with pytest.raises(InputError, match=rf"^f:{line}: cannot be parsed: .*; expected YAML"):
        parse_yaml(Path("f"), text)


@pytest.fixture
def ini(tmp_path: Path) -> Path:
    file = tmp_path / "icubEyes.ini"
    write_icub_eyes(file, LEFT_EYE, RIGHT_EYE)
    return file


def test_tabs_comments_and_foreign_keys_are_taken(ini):
    text = ini.read_text().replace("fx ", "fx\t\t").replace("[CAMERA", "// a remark\ndrawCenterCross\t0\n[CAMERA")
    ini.write_text(text + "\n[STEREO]\nfx wrong\n")
    assert read_icub_eyes(ini) == (LEFT_EYE, RIGHT_EYE)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fx 219.057", "fx abc", r"icubEyes\.ini:5: fx abc; expected a finite number"),
        ("fx 219.057", "fx nan", r"icubEyes\.ini:5: fx nan; expected a finite number"),
        ("fx 219.057", "fx 0", r"icubEyes\.ini:5: fx 0; expected a positive"),
        ("w 320", "w 0.3", r"icubEyes\.ini:3: w 0\.3; expected a whole number"),
        ("w 320", "w 65537", r"icubEyes\.ini:3: w 65537; expected a whole number of pixels, at most 65536"),
        ("h 240", "h 0", r"icubEyes\.ini:4: h 0; expected a positive number"),
        ("h 240", "h 240.5", r"icubEyes\.ini:4: h 240\.5; expected a whole number"),
        ("fx 219.057", "fx 1e308", r"icubEyes\.ini: .*fx 1e\+308.*; expected a camera whose"),
        ("fx 219.057", "fx 1e-300", r"icubEyes\.ini: .*fx 1e-300.*; expected a camera whose"),
        ("k1 -0.374173", "k1 1e9", r"icubEyes\.ini: .*1000000000\.0.*; expected a camera whose"),
        ("k1 -0.374173", "k1 -3", r"icubEyes\.ini: .*-3\.0.*; expected a camera whose"),
        ("k2 0.205428", "k2 1e308", r"icubEyes\.ini: .*1e\+308.*; expected a camera whose"),
        (f"cx {LEFT_EYE.cx!r}", "cx 1e9", r"icubEyes\.ini: .*cx 1e\+09.*; expected a camera whose"),
        ("fx 219.057", "", r"icubEyes\.ini:1: \[CAMERA_CALIBRATION_LEFT\] has no fx"),
        ("[CAMERA_CALIBRATION_RIGHT]", "[OTHER]", r"icubEyes\.ini: no section \[CAMERA_CALIBRATION_RIGHT\]"),
    ],
)
def test_what_is_missing_is_named(ini, old, new, message):
    assert old in ini.read_text()
    ini.write_text(ini.read_text().replace(old, new))
    with pytest.raises(InputError, match=message):
        read_icub_eyes(ini)


def test_a_resized_image_shows_the_same_point_at_the_resized_camera(ini):
    # the oracle is OpenCV's own resizing: the centroid of a blob seen by either camera
    left, _ = read_icub_eyes(ini, (640, 480))
    point = np.array([0.05, 0.02, 0.4])
    u, v = LEFT_EYE.project(point)
    rows, columns = np.mgrid[:240, :320]
    blob = np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / 18)
    large = cv2.resize(blob, (640, 480), interpolation=cv2.INTER_AREA)
    rows, columns = np.mgrid[:480, :640]
    centroid = np.array([(large * columns).sum(), (large * rows).sum()]) / large.sum()
    np.testing.assert_allclose(left.project(point), centroid, atol=0.01)


def test_other_proportions_are_refused():
    with pytest.raises(InputError, match=r"a\.ini: calibrated for 320×240 pixels, images are 640×360"):
        fit_to_images(LEFT_EYE, (640, 360), Path("a.ini"))
    assert fit_to_images(LEFT_EYE, (640, 481), Path("a.ini")).height == 481  # a pixel of rounding
    with pytest.raises(InputError, match="expected the same proportions"):
        fit_to_images(LEFT_EYE, (640, 482), Path("a.ini"))
