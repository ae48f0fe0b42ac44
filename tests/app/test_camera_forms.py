"""Films through other lenses, cut out, binned or at another resolution, with the calibration that says so or is asked:
`track` is within a millimetre of the ball's true path."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibrations import store
from filmed import SCENE, SIZE, calibration, film, track_error_mm, write_video, write_videos

from pps_vision.app.cli import main
from pps_vision.geometry.camera import Camera
from pps_vision.geometry.se3 import inverse
from pps_vision.types import Array, Image

ORIGIN = np.zeros(3)
FISHEYE = np.array([0.05, -0.02, 0.01, -0.003])
RATIONAL = np.array([0.2, 0.05, 0.001, -0.001, 0.01, 0.4, 0.08, 0.005])
THIN_PRISM = np.array([*RATIONAL, 0.01, -0.002, -0.008, 0.001])
TILTED = np.array([*THIN_PRISM, 0.03, -0.02])


def seen_through(camera: Camera, K: Array, D: Array) -> Callable[[Image], Image]:
    """A film's image through a lens K, D (fisheye where D has 4 numbers), all by OpenCV."""
    pixels = np.stack(np.meshgrid(*map(np.arange, SIZE)), axis=-1).reshape(-1, 1, 2).astype(float)
    if len(D) == 4:
        normalised = cv2.fisheye.undistortPoints(pixels, K, D)
    else:
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
        normalised = cv2.undistortPointsIter(pixels, K, D, np.eye(3), np.eye(3), stop)
    rays = cv2.convertPointsToHomogeneous(normalised)
    at = cv2.projectPoints(rays, ORIGIN, ORIGIN, camera.K, camera.lens)[0].reshape(SIZE[1], SIZE[0], 2)
    return lambda image: cv2.remap(image, *np.float32(np.moveaxis(at, 2, 0)), cv2.INTER_CUBIC)


def write(folder: Path, change: Callable[[Camera], Callable[[Image], Image]]) -> list[str]:
    """Videos of both cameras with changed images; options --left and --right."""
    shown, sides = film()
    words = []
    for side, camera, images in zip(("left", "right"), (shown.rig.left, shown.rig.right), sides, strict=True):
        words += [f"--{side}", str(write_video(folder / f"{side}.mp4", map(change(camera), images)))]
    return words


LENSES = {"rational": RATIONAL, "thin prism": THIN_PRISM, "tilted": TILTED, "fisheye": FISHEYE}


@pytest.mark.parametrize(
    "name", ["tilted", "fisheye", *(pytest.param(name, marks=pytest.mark.long) for name in ("rational", "thin prism"))]
)
def test_lenses(tmp_path, name, capsys):
    """A tilted lens has the coefficients of the rational one and the thin prism too."""
    lens = LENSES[name]
    words = write(tmp_path, lambda camera: seen_through(camera, camera.K, lens))
    words += ["--calib", str(calibration(tmp_path / "calib.yml", film()[0], D1=lens, D2=lens))]
    if len(lens) == 4:
        with pytest.raises(SystemExit):
            main(["info", *words])
        asked = "D1 holds 4 coefficients of a lens model that is not stated; expected --lens radtan"
        assert asked in capsys.readouterr().err
        words += ["--lens", "fisheye"]
    assert track_error_mm(words, film()[0], tmp_path / "path") < 1


@pytest.mark.parametrize("binning", [1, 2])
def test_a_region_of_interest_and_binning_of_ros(tmp_path, binning):
    """A sensor of twice the film's pixels, read in part and binned, with camera_info that OpenCV rectified."""
    x, y, width, height = 80, 40, 480, 400
    shown = film()[0]
    view = shown.rig.view()
    T = inverse(view.right.T_root_camera) @ view.left.T_root_camera
    double = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    sensors = [(double @ camera.K, camera.lens) for camera in (shown.rig.left, shown.rig.right)]
    R1, R2, P1, P2, *_ = cv2.stereoRectify(*sensors[0], *sensors[1], (640, 480), T[:3, :3], T[:3, 3])
    for side, (K, D), R, P in zip(("left", "right"), sensors, (R1, R2), (P1, P2), strict=True):
        (tmp_path / f"{side}.yaml").write_text(
            f"width: 640\nheight: 480\ndistortion_model: plumb_bob\nD: {D.tolist()}\n"
            f"K: {K.ravel().tolist()}\nR: {R.ravel().tolist()}\nP: {P.ravel().tolist()}\n"
            f"binning_x: {binning}\nbinning_y: {binning}\n"
            f"roi: {{x_offset: {x}, y_offset: {y}, width: {width}, height: {height}, do_rectify: False}}\n"
        )

    def read_out(image: Image) -> Image:
        sensor = cv2.resize(image, (640, 480), interpolation=cv2.INTER_CUBIC)[y : y + height, x : x + width]
        return cv2.resize(sensor, (width // binning, height // binning), interpolation=cv2.INTER_AREA)

    words = write(tmp_path, lambda _: read_out)
    words += ["--calib", str(tmp_path / "left.yaml"), str(tmp_path / "right.yaml")]
    assert track_error_mm(words, shown, tmp_path / "path") < 1


@pytest.mark.parametrize(
    ("change", "options"),
    [
        (lambda image: image[10:230, 30:310], ["--crop", "30", "10"]),
        (lambda image: cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC), ["--scaled"]),
    ],
    ids=["crop", "scaled"],
)
def test_images_of_another_size_than_the_calibration(tmp_path, change, options):
    shown, words = write_videos(tmp_path, change=change)
    assert track_error_mm([*words, *options], shown, tmp_path / "path") < 1


def test_rectified_images_with_the_projections_of_stereo_rectify(tmp_path):
    """The path is in the rectified left camera's frame, R1 times that of the original one."""
    shown, sides = film()
    view = shown.rig.view()
    T = inverse(view.right.T_root_camera) @ view.left.T_root_camera
    cameras = shown.rig.left, shown.rig.right
    lenses = [matrix for camera in cameras for matrix in (camera.K, camera.lens)]
    R1, R2, P1, P2, Q, *_ = cv2.stereoRectify(*lenses, SIZE, T[:3, :3], T[:3, 3], alpha=0)
    words = ["--calib", str(store(tmp_path / "extrinsics.yml", R1=R1, R2=R2, P1=P1, P2=P2, Q=Q))]
    for side, camera, images, R, P in zip(("left", "right"), cameras, sides, (R1, R2), (P1, P2), strict=True):
        maps = cv2.initUndistortRectifyMap(camera.K, camera.lens, R, P, SIZE, cv2.CV_32FC1)
        rectified = (cv2.remap(image, *maps, cv2.INTER_CUBIC) for image in images)
        words += [f"--{side}", str(write_video(tmp_path / f"{side}.mp4", rectified))]
    assert track_error_mm(words, shown, tmp_path / "path", R=R1) < 1


def test_stamps_are_read_in_the_unit_that_fits_the_video(tmp_path, capsys):
    """Milliseconds, of other numbers of rows; a wrong unit is told, by `info` and by `track`."""
    shown, words = write_videos(tmp_path)
    n = len(film()[1][0])
    for side, began_ms in (("left", 1000.0), ("right", 1000.4)):
        rows = (f"{began_ms + 1000 * k / SCENE.fps:.3f}\n" for k in range(n))
        (tmp_path / f"{side}.txt").write_text("".join(rows))
    words += ["--times", str(tmp_path / "left.txt"), str(tmp_path / "right.txt")]
    assert track_error_mm(words, shown, tmp_path / "path", start_s=1.0) < 1.5
    main(["info", *words, "--times-unit", "s", "--max-skew-s", "1"])
    told = capsys.readouterr().out
    assert "(0.025 frames/s) replaces the files' own 25.00" in told
    assert "try --times-unit, --fps or other stamps: there are 0.025 pairs/s" in told
    main(["track", *words, "--times-unit", "s", "--max-skew-s", "1", "--out", str(tmp_path / "wrong")])
    told = capsys.readouterr().out
    assert "try --times-unit, --fps or other stamps: there are 0.025 pairs/s" in told
    assert "nothing moves" not in told
