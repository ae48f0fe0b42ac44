"""A calibration or images that do not belong to a recording are told by points of its scene, in `info` and `track`.

A ball before a wall, by cameras 12 cm apart that converge by 9.5° and are rolled by 2° to each other.
"""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from filmed import SCENE, calibration, track_error_mm
from scipy.spatial.transform import Rotation

from pps_vision.app.cli import main
from pps_vision.experiments.severity.inputs import RigFilm
from pps_vision.geometry.se3 import transform
from pps_vision.types import Array

N = 20


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> tuple[RigFilm, Path]:
    """The film, and a folder with its images."""
    turns = [Rotation.from_rotvec(np.deg2rad([0.3 * s, -4.75 * s, s])).as_matrix() for s in (-1, 1)]
    poses = [transform(turn, (0.06 * s, 0.004 * s, 0.006 * s)) for turn, s in zip(turns, (-1, 1), strict=True)]
    shown = RigFilm(replace(SCENE, seconds=N / SCENE.fps, rig="fixed"), 6, (poses[0], poses[1]))
    folder = tmp_path_factory.mktemp("converging")
    for k, frame in enumerate(shown):
        cv2.imwrite(str(folder / f"L{k:02d}.png"), frame.left[..., ::-1])
        cv2.imwrite(str(folder / f"R{k:02d}.png"), frame.right[..., ::-1])
    return shown, folder


def words(folder: Path, calib: Path) -> list[str]:
    sides = ["--left", str(folder / "L*.png"), "--right", str(folder / "R*.png")]
    return [*sides, "--fps", "25", "--calib", str(calib)]


def advice(capsys, options: list[str]) -> str:
    """The first advice of `info`."""
    capsys.readouterr()
    main(["info", *options, "--json"])
    first, *_ = json.loads(capsys.readouterr().out)["warnings"]
    return str(first)


def is_told_by_track(advice: str, options: list[str], out: Path, capsys) -> bool:
    main(["track", *options, "--out", str(out)])
    return f"\n  {advice}" in capsys.readouterr().out


def test_sound_cameras_are_not_warned_of(filmed, tmp_path, capsys):
    shown, folder = filmed
    options = words(folder, calibration(tmp_path / "c.yml", shown))
    assert track_error_mm(options, shown, tmp_path / "out") < 3
    assert "try" not in capsys.readouterr().out
    main(["info", *options])
    out = capsys.readouterr().out
    baseline_mm = 1000 * np.linalg.norm(shown.rig.view().right.center)
    assert f"cameras: the right one lies {baseline_mm:.1f} mm to the right of the left one (measure it: all" in out
    assert "warning" not in out


def test_sound_cameras_before_a_soft_scene_are_not_warned_of(filmed, tmp_path, capsys):
    """Its few features are large, and located a pixel off."""
    shown, folder = filmed
    for path in folder.glob("*.png"):
        soft = cv2.GaussianBlur(cv2.imread(str(path)), (0, 0), 14.0).astype(float)
        noise = np.random.default_rng(len(path.name) + int(path.stem[1:])).normal(0, 1.5, soft.shape)
        cv2.imwrite(str(tmp_path / path.name), np.clip(soft + noise, 0, 255).astype(np.uint8))
    capsys.readouterr()
    main(["info", *words(tmp_path, calibration(tmp_path / "c.yml", shown)), "--json"])
    assert not any("calibration" in warning for warning in json.loads(capsys.readouterr().out)["warnings"])


Change = Callable[[Array, Array], tuple[Array, Array]]
GL = np.diag([1.0, -1, -1])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda R, T: (R.T, T), "try R of the calibration transposed, as MATLAB needs it: "),
        (
            lambda R, T: (R.T, -R.T @ T),
            "try R and T of the calibration inverted: they seem to lead from right to left: ",
        ),
        pytest.param(lambda R, T: (R, -T), "try T of the calibration with the other sign: ", marks=pytest.mark.long),
        (lambda R, T: (R, -R.T @ T), "try T of the calibration as -R T: it seems to be the right camera's place: "),
        (lambda R, T: (GL @ R @ GL, GL @ T), "try R and T of the calibration with OpenCV's axes, not OpenGL's: "),
    ],
)
def test_a_pose_of_another_convention(filmed, tmp_path, capsys, change: Change, said):
    """The remedy that is named fits within a tenth of a pixel."""
    shown, folder = filmed
    T_right_left = np.linalg.inv(shown.rig.view().right.T_root_camera)
    R, T = change(T_right_left[:3, :3], T_right_left[:3, 3])
    line = advice(capsys, words(folder, calibration(tmp_path / "c.yml", shown, R=R, T=T)))
    assert line.startswith(said)
    assert "then fit the cameras within 0.1 px (median), as they are " in line


def test_a_lost_convergence_is_told_in_degrees(filmed, tmp_path, capsys):
    shown, folder = filmed
    options = words(folder, calibration(tmp_path / "c.yml", shown, R=np.eye(3)))
    line = advice(capsys, options)
    assert is_told_by_track(line, options, tmp_path / "out", capsys)
    assert line.startswith("try another calibration")
    assert "most matches lie behind the cameras" in line
    turned = float(line.split("with the cameras turned by another ")[1].split("°")[0])
    T_left_right = shown.rig.view().right.T_root_camera
    assert turned == pytest.approx(np.rad2deg(Rotation.from_matrix(T_left_right[:3, :3]).magnitude()), abs=0.3)


@pytest.mark.parametrize(("axis", "misfit_px"), [(0, 1.44), (1, None), (2, 0.34)])
def test_a_rotation_off_by_0_3_degrees_is_told_as_far_as_points_show_it(filmed, tmp_path, capsys, axis, misfit_px):
    """Pitch moves points across the epipolar lines by 0.3° of 275 px, roll by that of their distance from the
    centre; yaw hardly does."""
    shown, folder = filmed
    T_right_left = np.linalg.inv(shown.rig.view().right.T_root_camera)
    R = Rotation.from_rotvec(np.deg2rad(0.3) * np.eye(3)[axis]).as_matrix() @ T_right_left[:3, :3]
    options = words(folder, calibration(tmp_path / "c.yml", shown, R=R))
    if misfit_px is None:
        main(["info", *options])
        assert "warning" not in capsys.readouterr().out
        return
    line = advice(capsys, options)
    assert line.startswith("try another calibration: ")
    assert float(line.split("only within ")[1].split()[0]) == pytest.approx(misfit_px, rel=0.2)


def test_cameras_of_the_calibration_exchanged(filmed, tmp_path, capsys):
    shown, folder = filmed
    left, right = replace(shown.rig.left, cy=shown.rig.left.cy - 9), shown.rig.right
    for k in range(N):  # a camera whose principal point is elsewhere
        image = cv2.imread(str(folder / f"L{k:02d}.png"))
        cv2.imwrite(str(tmp_path / f"L{k:02d}.png"), np.roll(image, -9, axis=0))
        cv2.imwrite(str(tmp_path / f"R{k:02d}.png"), cv2.imread(str(folder / f"R{k:02d}.png")))
    sound = calibration(tmp_path / "c.yml", shown, K1=left.K)
    main(["info", *words(tmp_path, sound)])
    assert "warning" not in capsys.readouterr().out
    swapped = calibration(tmp_path / "c.yml", shown, K1=right.K, K2=left.K)
    assert advice(capsys, words(tmp_path, swapped)).startswith("try the cameras of the calibration exchanged: ")


@pytest.mark.parametrize(
    ("sides", "change", "said"),
    [
        ("LR", np.fliplr, "both images not mirrored: "),
        ("R", np.fliplr, "the right image not mirrored: "),
        pytest.param("L", np.fliplr, "the left image not mirrored: ", marks=pytest.mark.long),
        pytest.param("LR", lambda image: image[::-1, ::-1], "both images turned by 180°: ", marks=pytest.mark.long),
        pytest.param("R", lambda image: image[::-1, ::-1], "the right image turned by 180°: ", marks=pytest.mark.long),
        ("RL", lambda image: image, "--left and --right exchanged, or the folders cam/left and cam/right: "),
    ],
)
def test_images_that_are_mirrored_turned_or_exchanged(filmed, tmp_path, capsys, sides, change, said):
    shown, folder = filmed
    names = {"L": "R", "R": "L"} if sides == "RL" else {"L": "L", "R": "R"}
    for side, name in names.items():
        for k in range(N):
            image = cv2.imread(str(folder / f"{side}{k:02d}.png"))
            cv2.imwrite(str(tmp_path / f"{name}{k:02d}.png"), change(image) if side in sides else image)
    line = advice(capsys, words(tmp_path, calibration(tmp_path / "c.yml", shown)))
    assert said in line
    assert line.startswith("try ")


def test_without_points_only_a_right_camera_on_the_left_is_said(filmed, tmp_path, capsys):
    shown, _ = filmed
    for side in "LR":
        for k in range(3):
            cv2.imwrite(str(tmp_path / f"{side}{k:02d}.png"), np.full((240, 320, 3), 90 + k, np.uint8))
    T = np.array([0.12, 0, 0])
    for sign, n in ((1, 1), (-1, 0)):
        main(["info", *words(tmp_path, calibration(tmp_path / "c.yml", shown, R=np.eye(3), T=sign * T))])
        out = capsys.readouterr().out
        assert out.count("another calibration: by it the right camera lies 120 mm to the LEFT of the left one") == n


def test_a_field_of_view_of_177_degrees(filmed, tmp_path, capsys):
    shown, folder = filmed
    K = shown.rig.left.K.copy()
    K[:2, :2] *= 4.2 / K[0, 0]
    calib = calibration(tmp_path / "c.yml", shown, K1=K, K2=K, D1=np.zeros(5), D2=np.zeros(5))
    main(["info", *words(folder, calib)])
    assert "try another calibration: the left camera's field of view is 177°" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (np.deg2rad, "as if it were in radians"),
        (np.zeros_like, "as if it stood still"),
        (np.negative, "other than the images"),
    ],
)
def test_a_head_s_log_that_lies_is_told_by_its_images(swaying, tmp_path, capsys, change, said):
    """The arms' logs are in degrees and beyond ±3.14."""
    rec = tmp_path / "rec"
    shutil.copytree(swaying, rec)
    log = rec / "head" / "data.log"
    rows = np.loadtxt(log)
    np.savetxt(log, np.c_[rows[:, :2], change(rows[:, 2:])], "%.9f")
    line = advice(capsys, [str(rec)])
    assert line.startswith("try another log of the head, or one in degrees: from 0.00 s to ")
    assert line.endswith(said)
    assert change is not np.negative or is_told_by_track(line, [str(rec)], tmp_path / "out", capsys)


@pytest.fixture(scope="module")
def swaying(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot whose eyes follow a ball; nothing is warned of."""
    rec = tmp_path_factory.mktemp("swaying") / "rec"
    main(["render", "--stimulus", "ball", "--motion", "circle", "--seconds", "2", "--seed", "5", "--out", str(rec)])
    return rec


def test_a_sound_robot_is_not_warned_of(swaying, capsys):
    capsys.readouterr()
    main(["info", str(swaying)])
    assert "warning" not in capsys.readouterr().out
