"""One stereo camera in the calibration of every tool, as its documentation says, and the iCub's own file."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pps_vision.errors import InputError
from pps_vision.recordings.calibration_files import parse_yaml
from pps_vision.recordings.icub_eyes import fit_to_images, read_icub_eyes, write_icub_eyes
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.robot.icub import LEFT_EYE, RIGHT_EYE

SIZE = (640, 480)
K1, K2 = (np.array([[f, 0, 320], [0, f + 5, 240], [0, 0, 1.0]]) for f in (500, 520))
D1 = [-0.3, 0.1, 0.001, 0.002]
D2 = [-0.2, 0.05, 0.003, 0.004]
ROTATION = np.array([0.01, -0.1, 0.02])
T_RIGHT_LEFT = np.eye(4)
T_RIGHT_LEFT[:3, :3] = cv2.Rodrigues(ROTATION)[0]
T_RIGHT_LEFT[:3, 3] = (-0.12, 0.003, 0.01)
T_BODY_LEFT = np.eye(4)
T_BODY_LEFT[:3, :3] = cv2.Rodrigues(np.array([0.4, 1.1, -0.3]))[0]
T_BODY_LEFT[:3, 3] = (0.05, -0.2, 0.3)


def intrinsics(K: np.ndarray) -> list[float]:
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]).tolist()


def kalibr(folder: Path) -> list[Path]:
    rows = "".join(f"  - {row.tolist()}\n" for row in T_RIGHT_LEFT)
    cameras = [
        f"cam{k}:\n{pose}  camera_model: pinhole\n  distortion_coeffs: {D}\n  distortion_model: radtan\n"
        f"  intrinsics: {intrinsics(K)}\n  resolution: [640, 480]\n  rostopic: /cam{k}/image_raw\n"
        for k, (pose, K, D) in enumerate([("", K1, D1), (f"  T_cn_cnm1:\n{rows}", K2, D2)])
    ]
    (folder / "camchain.yaml").write_text("".join(cameras))
    return [folder / "camchain.yaml"]


def euroc(folder: Path) -> list[Path]:
    poses = (T_BODY_LEFT, T_BODY_LEFT @ np.linalg.inv(T_RIGHT_LEFT))
    for k, (T_BS, K, D) in enumerate(zip(poses, (K1, K2), (D1, D2), strict=True)):
        data = ",\n         ".join(str(row.tolist())[1:-1] for row in T_BS)
        (folder / f"{k}.yaml").write_text(
            f"# General sensor definitions.\nsensor_type: camera\ncomment: VI-Sensor cam{k} (MT9M034)\n\n"
            f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{data}]\nrate_hz: 20\nresolution: [640, 480]\n"
            f"camera_model: pinhole\nintrinsics: {intrinsics(K)} #fu, fv, cu, cv\n"
            f"distortion_model: radial-tangential\ndistortion_coefficients: {D}\n"
        )
    return [folder / "0.yaml", folder / "1.yaml"]


def ros(folder: Path) -> list[Path]:
    """camera_calibration's files, rectified by OpenCV itself."""
    lenses = np.append(D1, 0), np.append(D2, 0)
    R1, R2, P1, P2, *_ = cv2.stereoRectify(
        K1, lenses[0], K2, lenses[1], SIZE, T_RIGHT_LEFT[:3, :3], T_RIGHT_LEFT[:3, 3]
    )
    for name, *matrices in (("left", K1, lenses[0][None], R1, P1), ("right", K2, lenses[1][None], R2, P2)):
        keys = ("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix")
        entries = "".join(
            f"{key}:\n  rows: {M.shape[0]}\n  cols: {M.shape[1]}\n  data: {M.ravel().tolist()}\n"
            for key, M in zip(keys, matrices, strict=True)
        )
        head = f"image_width: 640\nimage_height: 480\ncamera_name: {name}\ndistortion_model: plumb_bob\n"
        (folder / f"{name}.yaml").write_text(head + entries)
    return [folder / "left.yaml", folder / "right.yaml"]


def anipose(folder: Path) -> list[Path]:
    """Poses from the world, here the left camera turned."""
    world = np.eye(4)
    world[:3, :3] = cv2.Rodrigues(np.array([0.2, -0.5, 0.1]))[0]
    world[:3, 3] = (0.3, 0.2, 1.0)
    text = ""
    for k, (pose, K, D) in enumerate([(world, K1, D1), (T_RIGHT_LEFT @ world, K2, D2)]):
        text += (
            f'[cam_{k}]\nname = "{k}"\nsize = [ 640, 480,]\nmatrix = {K.tolist()}\ndistortions = {[*D, 0.0]}\n'
            f"rotation = {cv2.Rodrigues(pose[:3, :3])[0].ravel().tolist()}\ntranslation = {pose[:3, 3].tolist()}\n\n"
        )
    (folder / "calibration.toml").write_text(text + "[metadata]\nadjusted = false\nerror = 0.5\n")
    return [folder / "calibration.toml"]


@pytest.mark.parametrize("write", [kalibr, euroc, ros, anipose])
def test_a_stereo_camera(tmp_path, write):
    left, right, T_left_right = read_stereo_calibration(write(tmp_path), SIZE)
    np.testing.assert_allclose([left.K, right.K], [K1, K2])
    np.testing.assert_allclose([left.distortion, right.distortion], [[*D1, 0], [*D2, 0]])
    np.testing.assert_allclose(T_left_right @ T_RIGHT_LEFT, np.eye(4), atol=1e-9)
    half = read_stereo_calibration(write(tmp_path), (320, 240), unit_m=0.001)
    np.testing.assert_allclose(half[0].fx, 250)
    np.testing.assert_allclose(half[2][:3, 3], T_left_right[:3, 3] / 1000)


@pytest.mark.parametrize("form", ["P{}: {}\n", "P_rect_0{}: {}\n"])
def test_kitti(tmp_path, form):
    """The numbers of KITTI's odometry sequence 00: cameras 0 and 1 are 53.7 cm apart."""
    K = "718.856 0.0 607.1928 {} 0.0 718.856 185.2157 {} 0.0 0.0 1.0 {}"
    others = ("0.0 0.0 0.0", "-386.1448 0.0 0.0", "45.38225 -0.1130887 0.003779761", "-337.2877 2.369057 0.004915215")
    text = "".join(form.format(k, K.format(*words.split())) for k, words in enumerate(others))
    (tmp_path / "calib.txt").write_text(text + "Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n")
    left, right, T = read_stereo_calibration([tmp_path / "calib.txt"], (1241, 376))
    np.testing.assert_allclose(T[:3, 3], [386.1448 / 718.856, 0, 0])
    assert (left, left.fx, left.cx, left.distortion) == (right, 718.856, 607.1928, (0,) * 5)
    _, _, T = read_stereo_calibration([tmp_path / "calib.txt"], (1241, 376), kitti=(2, 3))
    places = [np.linalg.solve(left.K, np.array(words.split(), float)) for words in others[2:]]
    np.testing.assert_allclose(T[:3, 3], places[0] - places[1], atol=1e-9)


@pytest.mark.parametrize(
    ("write", "original", "instead", "message"),
    [
        (kalibr, "cam1:", "cam1: 3\ncam2:", "cam1 is '3'; expected the entries of a camera"),
        (kalibr, "cam1:", "cam2:", r"camchain\.yaml: holds no calibration"),
        (kalibr, "intrinsics: [500.0", "intrinsics: [1.2e9", "intrinsics is .* expected 4 numbers"),
        (kalibr, "cam0", "# " + "x" * 2**18 + "\ncam0", "more than 262144 characters or is nested"),
        (kalibr, "cam0", "#" + 200_000 * "[" + "\ncam0", "characters or is nested; expected a calibration"),
        (kalibr, "radtan", "equidistant", "distortion_model equidistant; expected one of radtan"),
        (kalibr, "camera_model: pinhole", "camera_model: omni", "camera_model omni; expected pinhole"),
        (kalibr, "T_cn_cnm1", "T_cam_imu", "T_cn_cnm1 is None; expected 4×4 numbers"),
        (euroc, "resolution: [640, 480]", "resolution: [640]", "resolution is .* expected 2 numbers"),
        (euroc, "data: [", "data: [nan, ", "T_BS is .* expected 4×4 numbers"),
        (euroc, "rate_hz: 20", "rate_hz: &x 20", r"0\.yaml:12: cannot be parsed"),
        (ros, "rows: 3\n", "rows: 3\n  rows: 3\n", "rows again"),
        (anipose, "size", "[size", "cannot be parsed: .*line 3"),
        (anipose, "[metadata]", "[cam_2]", "holds 3 cameras"),
        (anipose, "rotation", "fisheye = true\nrotation", "fisheye is true"),
    ],
)
def test_what_cannot_be_used_is_named(tmp_path, write, original, instead, message):
    files = write(tmp_path)
    files[0].write_text(files[0].read_text().replace(original, instead, 1))
    with pytest.raises(InputError, match=message):
        read_stereo_calibration(files, SIZE)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("P1:", "P0:", r"P0 2 times; expected it once, with 12 numbers"),
        ("P1:", "P7:", r"P1 0 times; expected it once"),
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
        *(("a: [1", 1), ("a: 1\n b: 2", 2), ("a: [b]]\n- [", 1), ("a:\n\tb: 1", 2), ("a: 'x", 1)),
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


def test_what_is_written_is_read(ini):
    assert read_icub_eyes(ini) == (LEFT_EYE, RIGHT_EYE)


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
