"""Stereo calibration from rendered views of boards by two known cameras."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from data import SEED
from flat_patterns import SIZE, K, R, T, seen
from scipy.spatial.transform import Rotation
from videos import write_video

from pps_vision.app.calibrate import REFUSED_RMS_PX, WARNED_RMS_PX, Board, BoardView, board_pairs, calibrate
from pps_vision.app.cli import main
from pps_vision.errors import InputError
from pps_vision.recordings.stereo_calibration import read_stereo_calibration
from pps_vision.recordings.warnings import Problem

SQUARE_PX = 60
SQUARE_M = 0.03


def pattern(charuco: bool, legacy: bool = False) -> np.ndarray:
    """A board of 9×6 squares seen from the front, with a white margin of one square."""
    if charuco:
        markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
        board = cv2.aruco.CharucoBoard((9, 6), SQUARE_M, 0.022, markers)
        board.setLegacyPattern(legacy)
        drawn = board.generateImage((9 * SQUARE_PX, 6 * SQUARE_PX))
    else:
        rows, columns = np.mgrid[: 6 * SQUARE_PX, : 9 * SQUARE_PX] // SQUARE_PX
        drawn = np.where((rows + columns) % 2, 255, 0).astype(np.uint8)
    return cv2.copyMakeBorder(drawn, *[SQUARE_PX] * 4, cv2.BORDER_CONSTANT, value=255)


def write_views(
    folder: Path,
    board: np.ndarray,
    n: int = 4,
    aside_m: float = 0.0,
    shown: Callable[[np.ndarray, int], np.ndarray] = lambda image, side: image,
) -> list[str]:
    """Images of a board held in front of both cameras, as the camera of a side has them `shown`; the command without
    the board's size."""
    rng = np.random.default_rng(SEED)
    for k in range(n):
        turn = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)).as_matrix()
        at = np.array([*rng.uniform(-aside_m, aside_m, 2), rng.uniform(0.45, 0.6)]) + np.array([0.05, 0, 0])
        for side, name in enumerate(("left", "right")):
            image = seen(board, SQUARE_M / SQUARE_PX, turn, at, side)
            cv2.imwrite(str(folder / f"{name}{k}.png"), shown(image, side))
    words = ["calibrate", "--left", folder / "left*.png", "--right", folder / "right*.png", "--square-mm", 30]
    return [*map(str, words), "--out", str(folder / "out")]


@pytest.mark.parametrize("charuco", [False, True])
def test_known_cameras_are_found(tmp_path, charuco, capsys):
    words = write_views(tmp_path, pattern(charuco), 7, 0.06)
    for name in ("left", "right"):  # no board here
        cv2.imwrite(str(tmp_path / f"{name}99.png"), np.full(SIZE[::-1], 90, np.uint8))
    out = tmp_path / "out"
    main([*words, "--board", *(("9", "6", "--marker-mm", "22") if charuco else ("8", "5"))])
    said = capsys.readouterr()
    assert "left99.png and right99.png: no board found" in said.err
    exchanged = [{"--left": "--right", "--right": "--left"}.get(word, word) for word in words[:-1]]
    main([*exchanged, str(tmp_path / "o"), "--board", *(("9", "6", "--marker-mm", "22") if charuco else ("8", "5"))])
    assert "mm to the LEFT of the left one: are --left and --right exchanged?" in capsys.readouterr().err
    assert re.match(r"7 of 8 pairs; RMS left 0\.\d{3}, .* baseline 1[12]\d\.\d{2} mm, .* px → ", said.out)
    left, right, T_left_right = read_stereo_calibration([out / "calibration.yml"], SIZE)
    for camera, truth in ((left, K[0]), (right, K[1])):
        np.testing.assert_allclose([camera.fx, camera.fy], [truth[0, 0], truth[1, 1]], rtol=0.004)
        np.testing.assert_allclose([camera.cx, camera.cy], truth[:2, 2], atol=2.5)
    true = np.linalg.inv(np.block([[R, T[:, None]], [np.zeros((1, 3)), 1]]))
    np.testing.assert_allclose(T_left_right[:3, 3], true[:3, 3], atol=1e-3)
    assert np.linalg.norm(Rotation.from_matrix(T_left_right[:3, :3].T @ true[:3, :3]).as_rotvec()) < 5e-3
    summary = json.loads((out / "summary.json").read_text())
    assert summary["pairs"] >= 6
    assert summary["rms_px"]["stereo"] < 0.15
    assert abs(summary["focal_px"][0] - 520) < 4 * summary["focal_std_px"][0]
    picture = cv2.imread(str(out / "reprojection.png"))
    assert picture is not None
    assert picture.std() > 5


def test_corners_of_a_board_tilted_by_76_degrees():
    """Rows lie a quarter as far apart as columns: a window for the columns' distance would hold other corners."""
    turn, at = Rotation.from_rotvec([np.deg2rad(76), 0, 0]).as_matrix(), np.array([0.0, 0.0, 0.4])
    grey = seen(pattern(False), SQUARE_M / SQUARE_PX, turn, at, 0)
    board = Board(8, 5, SQUARE_M)
    corners_px = board.find(cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB))
    corners = (board.corners - board.corners.mean(axis=0)) @ turn.T + at
    true = (corners @ K[0].T)[:, :2] / corners[:, 2:]
    px = np.array([corners_px[k] for k in range(len(true))])
    error = min(np.linalg.norm(order - true, axis=1).max() for order in (px, px[::-1]))  # either end may be the first
    assert error < 0.5


def test_what_cannot_be_calibrated(tmp_path, refused, refused_with):
    for k in range(2):
        for name in ("left", "right"):
            cv2.imwrite(str(tmp_path / f"{name}{k}.png"), np.full((60, 80), 90, np.uint8))
    images = "calibrate", "--left", tmp_path / "left*.png", "--right", tmp_path / "right*.png", "--out", tmp_path / "o"
    for board, why in (("0 5", "expected 3 to 100"), ("8 101", "expected 3 to 100")):
        assert why in refused(*images, "--board", *board.split(), "--square-mm", 30)
    assert "positive length" in refused(*images, "--board", 8, 5, "--square-mm", 0)
    assert "less than the squares" in refused(*images, "--board", 8, 5, "--square-mm", 30, "--marker-mm", 31)
    (tmp_path / "left1.png").write_bytes((tmp_path / "left0.png").read_bytes()[:40])
    lines = refused_with(*images, "--board", 8, 5, "--square-mm", 30)
    assert "no board found" in lines[0]
    assert "left1.png cannot be decoded" in lines[1]
    assert "in 0 pairs; expected at least 3" in lines[-1]
    assert not (tmp_path / "o").exists()
    with pytest.raises(InputError, match="dictionary '7X7_9'; expected one of OpenCV's"):
        Board(5, 5, 0.03, 0.02, "7X7_9")
    with pytest.raises(InputError, match="110 markers, and 5X5_100 has 100; expected a larger one"):
        Board(20, 11, 0.03, 0.02).find(np.zeros((60, 80, 3), np.uint8))


def corners_seen(tilt_deg: float, turned: tuple[float, float, float], rng: np.random.Generator) -> list[BoardView]:
    """Corners of 8 boards with 0.1 px of noise: a common rotation, then a tilt about different axes and a shift."""
    board = np.array([[0.03 * x, 0.03 * y, 0.0] for y in range(5) for x in range(8)])
    views = []
    for k in range(8):
        axis = (np.cos(np.pi * k / 4), np.sin(np.pi * k / 4), 0.0)
        tilt = Rotation.from_rotvec(np.deg2rad(tilt_deg) * np.array(axis))
        pose = Rotation.from_rotvec(turned) * tilt * Rotation.from_rotvec([0.0, 0.0, rng.uniform(-0.3, 0.3)])
        left = pose.apply(board - board.mean(axis=0)) + rng.uniform((-0.03, -0.03, 0.4), (0.13, 0.13, 0.7))
        rays = [(points @ camera.T) for points, camera in zip((left, left @ R.T + T), K, strict=True)]
        left_px, right_px = (p[:, :2] / p[:, 2:] + 0.1 * rng.normal(size=(len(p), 2)) for p in rays)
        views.append(BoardView(str(k), board.astype(np.float32), np.float32(left_px), np.float32(right_px)))
    return views


def test_boards_that_all_face_the_same_way_are_refused():
    """Parallel boards leave the focal lengths open (Zhang 2000), however far apart and turned in their plane."""
    rng = np.random.default_rng(SEED)
    turned = (0.5, 0.2, 0.0)
    with pytest.raises(InputError, match=r"same direction in all 8 views .*; expected some tilted by 20° or more"):
        calibrate(SIZE, corners_seen(0.0, turned, rng))
    with pytest.raises(InputError, match="same direction"):
        calibrate(SIZE, corners_seen(4.5, turned, rng))
    for tilt_deg, within in ((5.5, 0.06), (20.0, 0.03)):  # to either side: the boards differ by twice that
        calibration = calibrate(SIZE, corners_seen(tilt_deg, turned, rng))
        np.testing.assert_allclose(calibration.K[:, 0, 0], [520, 498], rtol=within)
    calibration = calibrate(SIZE, corners_seen(20.0, turned, np.random.default_rng(SEED)))
    noise_px = np.sqrt(2) * 0.1 * np.sqrt(1 - 72 / 1280)  # 72 parameters from 1280 coordinates
    rms = calibration.summary()["rms_px"]
    assert rms == pytest.approx(dict.fromkeys(("left", "right", "stereo"), noise_px), rel=0.03)
    assert (np.abs(calibration.K[:, 0, 0] - [520, 498]) < 3 * calibration.focal_std_px).all()


def test_three_views_are_enough_and_each_must_span_a_plane():
    views = corners_seen(20.0, (0.5, 0.2, 0.0), np.random.default_rng(SEED))
    np.testing.assert_allclose(calibrate(SIZE, views[:3]).K[:, 0, 0], [520, 498], rtol=0.03)
    with pytest.raises(InputError, match="in 2 pairs; expected at least 3"):
        calibrate(SIZE, views[:2])
    in_a_row = [BoardView(view.name, view.corners[:8], view.left_px[:8], view.right_px[:8]) for view in views]
    with pytest.raises(InputError, match=r"the views do not determine the cameras \(.*\); add others"):
        calibrate(SIZE, in_a_row)
    nowhere = [BoardView(view.name, view.corners, np.nan * view.left_px, view.right_px) for view in views]
    with pytest.raises(InputError, match="the views do not determine the cameras; add boards at other angles"):
        calibrate(SIZE, nowhere)


def test_images_of_a_board_are_paired_by_number(tmp_path):
    for name in ("l1", "l2", "l3", "r1", "r3"):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.zeros((48, 64, 3), np.uint8))
    problems: list[Problem] = []
    pairs = board_pairs([str(tmp_path / "l*.png")], [str(tmp_path / "r*.png")], None, 0.01, problems)
    assert [[file.title for file in pair] for pair in pairs] == [["l1.png", "r1.png"], ["l3.png", "r3.png"]]
    assert ["l2.png is unpaired" in str(problem) for problem in problems] == [True]


def test_two_videos_of_a_board_are_paired_by_their_stamps(tmp_path):
    """60 of 130 pairs, from the first to the last; the right eye is 4 ms late, and lacks one frame."""
    stamps = [0.02 * k for k in range(130)]
    left = write_video(tmp_path / "l.mp4", stamps)
    right = write_video(tmp_path / "r.mp4", [t + 0.004 for t in stamps if t != 0.2])
    problems: list[Problem] = []
    pairs = board_pairs([str(left)], [str(right)], None, 0.01, problems)
    assert len(pairs) == 60
    assert (pairs[0][0].stamp_s, pairs[-1][0].stamp_s) == pytest.approx((0.0, 2.58))
    assert all(0 < b.stamp_s - a.stamp_s < 0.005 for a, b in pairs)
    assert len(problems) == 1
    for lefts, message in (([str(left)] * 2, "one left and one right video"), ([], "left and right images, or two ")):
        with pytest.raises(InputError, match=f"expected {message}"):
            board_pairs(lefts, [str(right)], None, 0.01, problems)


@pytest.mark.parametrize(
    ("roll_deg", "both"), [(0.0, False), (90.0, False), (180.0, False), (45.0, False), (90.0, True)]
)
def test_cameras_that_are_rolled(tmp_path, capsys, roll_deg, both):
    """The right camera alone, or both; OpenCV numbers a board of 8×5 inner corners from either end."""
    turned = cv2.getRotationMatrix2D(((SIZE[0] - 1) / 2, (SIZE[0] - 1) / 2), roll_deg, 1.0)

    def shown(image: np.ndarray, side: int) -> np.ndarray:
        square = cv2.copyMakeBorder(image, 80, 80, 0, 0, cv2.BORDER_CONSTANT, value=90)
        return cv2.warpAffine(square, turned, (SIZE[0], SIZE[0]), borderValue=90) if side or both else square

    main([*write_views(tmp_path, pattern(False), 8, 0.03, shown), "--board", "8", "5"])
    assert capsys.readouterr().err == ""
    storage = cv2.FileStorage(str(tmp_path / "out" / "calibration.yml"), cv2.FILE_STORAGE_READ)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["rms_px"]["stereo"] < 0.3
    assert summary["baseline_mm"] == pytest.approx(1000 * np.linalg.norm(T), abs=1.5)
    roll = np.eye(4)
    roll[:2, :2] = turned[:, :2]
    true = roll[:3, :3] @ R @ (roll[:3, :3].T if both else np.eye(3))
    error = Rotation.from_matrix(storage.getNode("R").mat() @ true.T)
    assert np.rad2deg(error.magnitude()) < 3


def test_a_poor_calibration_is_warned_of_or_refused(tmp_path, capsys, refused):
    """Corners with 1.5 px of noise; views of one camera in another order."""
    rng = np.random.default_rng(SEED)
    views = corners_seen(20.0, (0.5, 0.2, 0.0), rng)
    noisy = [replace(v, left_px=np.float32(v.left_px + rng.normal(0, 1.5, v.left_px.shape))) for v in views]
    assert WARNED_RMS_PX < calibrate(SIZE, noisy).rms_px < REFUSED_RMS_PX
    shuffled = [replace(v, right_px=views[k - 1].right_px) for k, v in enumerate(views)]
    with pytest.raises(InputError, match=r"the RMS reprojection error is \d+\.\d px; expected below 1 px: sharp views"):
        calibrate(SIZE, shuffled)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pps_vision.app.calibrate.find_views", lambda *_: (SIZE, noisy, []))
        patch.setattr("pps_vision.app.calibrate.board_pairs", lambda *_: ())
        words = ["--left", "l", "--right", "r", "--board", "8", "5", "--square-mm", "30"]
        main(["calibrate", *words, "--out", str(tmp_path / "out")])
    assert re.search(r"warning: the RMS reprojection error is 1\.\d px; expected below 1:", capsys.readouterr().err)


def test_the_number_of_corners_is_guessed(tmp_path, refused):
    words = write_views(tmp_path, pattern(False))
    line = refused(*words, "--board", 9, 6)
    assert line.endswith(
        "no pair of images shows a board of 9×6; they seem to show 8×5 inner corners: expected --board 8 5"
    )
    main([*words, "--board", "8", "5"])


@pytest.mark.long
def test_markers_of_another_dictionary_are_named(tmp_path, refused):
    words = [*write_views(tmp_path, pattern(True)), "--board", "9", "6", "--marker-mm", "22", "--dictionary"]
    line = refused(*words, "4X4_50")
    named = re.search(r"\d+ markers of (5X5_\d+) are there: expected --dictionary 5X5_\d+, or another --board", line)
    main([*words, named[1]])


def test_a_charuco_board_of_older_opencv(tmp_path):
    words = write_views(tmp_path, pattern(True, legacy=True))
    main([*words, "--board", "9", "6", "--marker-mm", "22"])
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["baseline_mm"] == pytest.approx(1000 * np.linalg.norm(T), abs=2.0)
