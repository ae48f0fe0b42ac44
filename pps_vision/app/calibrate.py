"""Calibrate a stereo camera from images of a chessboard or charuco board: `pps-vision calibrate`."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure

from pps_vision.app.diagnosis import BASELINE_M
from pps_vision.app.progress import progress
from pps_vision.app.scene_points import length
from pps_vision.errors import InputError
from pps_vision.recordings.formats.stereo_images import open_stereo_images
from pps_vision.recordings.image_file import decode, used_bits
from pps_vision.recordings.recording import Pair, pair_by_stamp, usual_size
from pps_vision.recordings.source import expect_rate
from pps_vision.recordings.video import is_video, open_video
from pps_vision.recordings.warnings import Problem
from pps_vision.types import Array, Image

_FEWEST_VIEWS = 3  # that a planar board needs for four intrinsics and a lens (Zhang 2000)
WARNED_RMS_PX = 1.0
REFUSED_RMS_PX = 5.0
"""RMS reprojection errors: a good calibration has below 0.3 px, corners numbered or paired wrongly 10 and more."""
_GUESSED_FROM = 5  # pairs
_LEAST_TURN_DEG = 10.0  # between two boards; with ±5°, 40 % of the calibrations fail (Zhang 2000)
_FEWEST_CORNERS = 6  # in common, for the pose of a board in a view
_MOST_VIEWS = 60  # per video; more add time and no accuracy
_MOST_SQUARES = 100  # along one side
_HALF_WINDOW_PX = 11  # largest for subpixel refinement, as in OpenCV's sample stereo_calib
_WINDOW = 0.25  # half window relative to the distance of neighbouring corners, so that it holds a single corner


@dataclass(frozen=True)
class Board:
    """A chessboard, or with `marker_m` a charuco board."""

    columns: int  # inner corners (charuco: squares) along the longer side
    rows: int  # inner corners (charuco: squares) along the shorter side
    square_m: float  # side of a square
    marker_m: float | None = None  # side of a charuco board's markers
    dictionary: str = "5X5_100"  # name of the markers' dictionary in OpenCV, without DICT_
    legacy: bool = False  # a charuco board of OpenCV before 4.6: with an even number of rows it begins with a marker

    def __post_init__(self) -> None:
        if not all(3 <= n <= _MOST_SQUARES for n in (self.columns, self.rows)):
            expected = f"3 to {_MOST_SQUARES} inner corners (charuco: squares) a side"
            raise InputError("board", f"{self.columns}×{self.rows}; expected {expected}")
        if not 0 < self.square_m < np.inf:
            raise InputError("board", f"squares of {1000 * self.square_m:g} mm; expected a positive length")
        if self.marker_m is not None and not 0 < self.marker_m < self.square_m:
            raise InputError("board", f"markers of {1000 * self.marker_m:g} mm; expected less than the squares")
        if not hasattr(cv2.aruco, f"DICT_{self.dictionary}"):
            raise InputError("board", f"dictionary {self.dictionary!r}; expected one of OpenCV's, such as 5X5_100")

    @property
    def corners(self) -> Array:
        """(n, 3) m, the inner corners in the board's frame, in the order of their numbers."""
        if self.marker_m is not None:
            return np.asarray(self._charuco().getChessboardCorners(), dtype=np.float32)
        grid = np.mgrid[: self.columns, : self.rows].T.reshape(-1, 2)
        return (self.square_m * np.column_stack([grid, np.zeros(len(grid))])).astype(np.float32)

    def find(self, image: Image) -> dict[int, Array]:
        """Return the pixels (2,) of the detected corners by their number; a chessboard is detected as a whole."""
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        if self.marker_m is not None:
            pixels, numbers, _, _ = cv2.aruco.CharucoDetector(self._charuco()).detectBoard(grey)
            if numbers is None or len(numbers) < _FEWEST_CORNERS:
                return {}
            corners_px = np.asarray(pixels, dtype=float).reshape(-1, 2)
            return {int(k): pixel for k, pixel in zip(np.ravel(numbers), corners_px, strict=True)}
        is_complete, pixels = cv2.findChessboardCorners(grey, (self.columns, self.rows))
        if not is_complete:
            return {}
        grid = pixels.reshape(self.rows, self.columns, 2)
        spacing_px = min(np.linalg.norm(np.diff(grid, axis=k), axis=2).min() for k in (0, 1))
        half = int(np.clip(_WINDOW * spacing_px, 2, _HALF_WINDOW_PX))
        ends = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
        return dict(enumerate(cv2.cornerSubPix(grey, pixels, (half, half), (-1, -1), ends).reshape(-1, 2)))

    def _charuco(self) -> cv2.aruco.CharucoBoard:
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{self.dictionary}"))
        n_markers = self.columns * self.rows // 2
        if n_markers > (n := len(markers.bytesList)):
            raise InputError("board", f"{n_markers} markers, and {self.dictionary} has {n}; expected a larger one")
        board = cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, float(self.marker_m or 0), markers)
        board.setLegacyPattern(self.legacy)
        return board


@dataclass(frozen=True)
class BoardView:
    """A board in one pair of images: corners (n, 3) m and their left and right pixels (n, 2)."""

    name: str
    corners: Array
    left_px: Array
    right_px: Array


@dataclass(frozen=True)
class StereoCalibration:
    """Cameras, and residuals of the calibration."""

    image_size: tuple[int, int]  # width and height
    K: Array  # camera matrices (2, 3, 3) of left and right
    D: Array  # distortions (2, 5): k1, k2, p1, p2, k3
    R: Array  # (3, 3), p_right = R p_left + T
    T: Array  # (3,) m
    focal_std_px: Array  # (2,) standard deviation of fx, each camera calibrated by itself
    views: tuple[BoardView, ...]  # the views that were used
    residuals_px: tuple[tuple[Array, Array], ...]  # left and right residuals of every view, (n, 2) each

    @property
    def rms_px(self) -> float:
        """RMS reprojection error of both cameras together."""
        return _rms(np.concatenate([residuals for view in self.residuals_px for residuals in view]))

    def rms_of(self, side: int) -> float:
        """RMS reprojection error of the left (0) or the right (1) images, px."""
        return _rms(np.concatenate([view[side] for view in self.residuals_px]))

    def write(self, file: Path) -> None:
        """Write OpenCV's YAML, lengths in metres, as `pps-vision track --calib` reads it."""
        storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
        matrices = {"K1": self.K[0], "D1": self.D[0], "K2": self.K[1], "D2": self.D[1], "R": self.R, "T": self.T}
        for key, value in matrices.items():
            storage.write(key, value)
        for key, size in zip(("image_width", "image_height"), self.image_size, strict=True):
            storage.write(key, size)
        storage.release()

    def summary(self) -> dict[str, object]:
        """The numbers, for summary.json."""
        return {
            "pairs": len(self.views),
            "corners": sum(len(view.corners) for view in self.views),
            "rms_px": {"left": self.rms_of(0), "right": self.rms_of(1), "stereo": self.rms_px},
            "baseline_mm": 1000 * float(np.linalg.norm(self.T)),
            "focal_px": self.K[:, 0, 0],
            "focal_std_px": self.focal_std_px,
            "views": {
                view.name: [_rms(left), _rms(right)]
                for view, (left, right) in zip(self.views, self.residuals_px, strict=True)
            },
        }

    def faults(self) -> Iterator[str]:
        """Warnings of an implausible pose of the cameras to each other."""
        right = -self.R.T @ self.T  # in the left camera's frame
        apart = length(float(np.linalg.norm(right)))
        if not BASELINE_M[0] <= np.linalg.norm(right) <= BASELINE_M[1]:
            yield f"the cameras are {apart} apart: another --square-mm, or are left and right images the same?"
        elif right[0] == -np.abs(right).max():
            yield f"the right camera lies {apart} to the LEFT of the left one: are --left and --right exchanged?"

    def figure(self) -> Figure:
        """Reprojection errors: as arrows in each image, as a scatter plot, and as RMS per view."""
        figure = Figure(figsize=(11, 7.5), layout="constrained")
        axes = figure.subplots(2, 2)
        width, height = self.image_size
        arrows = {"angles": "xy", "scale_units": "xy", "scale": 0.02, "width": 0.002}
        for k, (view, residuals) in enumerate(zip(self.views, self.residuals_px, strict=True)):
            for axis, px, residual in zip(axes[0], (view.left_px, view.right_px), residuals, strict=True):
                axis.quiver(*px.T, *residual.T, color=f"C{k}", **arrows)
            axes[1, 0].scatter(*np.concatenate(residuals).T, s=3, color=f"C{k}")
        for side, (axis, title) in enumerate(zip(axes[0], ("left", "right"), strict=True)):
            axis.set(xlim=(0, width), ylim=(height, 0), aspect="equal", xlabel="x (px)", ylabel="y (px)")
            axis.set_title(f"{title}: RMS {self.rms_of(side):.3f} px; errors 50 times enlarged", fontsize=9)
        axes[1, 0].set(aspect="equal", xlabel="error in x (px)", ylabel="error in y (px)")
        axes[1, 0].grid(alpha=0.25)
        x = np.arange(len(self.views))
        for side, label in enumerate(("left", "right")):
            heights = [_rms(view[side]) for view in self.residuals_px]
            axes[1, 1].bar(x + 0.4 * side, heights, 0.4, label=label, color=("0.35", "0.7")[side])
        axes[1, 1].set_xticks(x + 0.2, [view.name for view in self.views], rotation=90, fontsize=6)
        axes[1, 1].set_ylabel("RMS by view (px)")
        axes[1, 1].legend(fontsize=8)
        baseline_mm = 1000 * np.linalg.norm(self.T)
        figure.suptitle(f"stereo RMS {self.rms_px:.3f} px, {len(self.views)} views, baseline {baseline_mm:.2f} mm")
        return figure


def board_pairs(
    left: Sequence[str], right: Sequence[str], fps: float | None, max_skew_s: float, problems: list[Problem]
) -> tuple[Pair, ...]:
    """Image pairs of the board: image files by the last number in their names, or a subset of two videos' frames."""
    if not (left and right):
        raise InputError("calibrate", "expected left and right images, or two videos")
    expect_rate(fps)
    if not any(is_video(Path(name)) for name in (*left, *right)):
        recording = open_stereo_images(left, right, fps or 1.0)
        problems += recording.problems
        return recording.pairs
    if len(left) != 1 or len(right) != 1:
        raise InputError("calibrate", "expected one left and one right video")
    pairs = pair_by_stamp(open_video(Path(left[0]), fps), open_video(Path(right[0]), fps), max_skew_s, problems)
    chosen = np.unique(np.linspace(0, len(pairs) - 1, _MOST_VIEWS).astype(int)) if pairs else np.empty(0, int)
    return tuple(pairs[k] for k in chosen)


def find_views(board: Board, pairs: Sequence[Pair]) -> tuple[tuple[int, int], list[BoardView], list[str]]:
    """Return the images' width and height, the views of the board, and the reasons for skipping other pairs.

    A charuco board that is not found is looked for as OpenCV drew it before 4.6.  InputError where no image shows the
    board but some show another one.
    """
    size = usual_size("calibrate", tuple(pairs), [])
    bits = used_bits([file for pair in pairs for file in pair])
    views: list[BoardView] = []
    skipped: list[str] = []
    for pair in progress(pairs, desc="calibrate", unit="pair"):
        images = [decode(file, size, bits) for file in pair]
        if bad := [str(image) for image in images if isinstance(image, Problem)]:
            skipped += bad
            continue
        detections = [board.find(image) for image in images if not isinstance(image, Problem)]
        if missing := [file.title for file, corners in zip(pair, detections, strict=True) if not corners]:
            expected = "all of a chessboard, or part of a charuco"
            skipped.append(f"{' and '.join(missing)}: no board found; expected {expected}")
            continue
        common = sorted(detections[0].keys() & detections[1].keys())
        if len(common) < _FEWEST_CORNERS:
            skipped.append(f"{pair[0].title}: {len(common)} corners in both images; expected {_FEWEST_CORNERS}")
            continue
        left_px, right_px = (np.array([corners[k] for k in common], np.float32) for corners in detections)
        views.append(BoardView(pair[0].title, board.corners[common], left_px, right_px))
    if not views and board.marker_m is not None and not board.legacy:
        older = find_views(replace(board, legacy=True), pairs)
        if older[1]:
            return older
    if not views and not board.legacy and (other := _other_board(board, pairs, size)):
        raise InputError("calibrate", f"no pair of images shows a board of {board.columns}×{board.rows}; {other}")
    return size, views, skipped


def _other_board(board: Board, pairs: Sequence[Pair], size: tuple[int, int]) -> str:
    """A board that the images may show instead, "" where none is recognised."""
    images = [image for pair in pairs[:_GUESSED_FROM] for image in (decode(file, size) for file in pair)]
    greys = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in images if not isinstance(image, Problem)]
    if board.marker_m is not None:
        counts = Counter[str]()
        for name in (name for name in dir(cv2.aruco) if name.startswith("DICT_")):
            markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
            detector = cv2.aruco.ArucoDetector(markers)
            counts[name.removeprefix("DICT_")] = sum(len(detector.detectMarkers(grey)[0]) for grey in greys)
        name, n = counts.most_common(1)[0]
        return f"{n} markers of {name} are there: expected --dictionary {name}, or another --board" if n else ""
    sizes = Counter[tuple[int, int]]()
    for grey in greys:
        is_found, _, meta = cv2.findChessboardCornersSBWithMeta(grey, (3, 3), cv2.CALIB_CB_LARGER)
        if is_found:
            rows, columns = sorted(np.shape(meta)[:2])
            sizes[columns, rows] += 1
    if not sizes:
        return ""
    columns, rows = sizes.most_common(1)[0][0]
    return f"they seem to show {columns}×{rows} inner corners: expected --board {columns} {rows}"


def calibrate(image_size: tuple[int, int], views: Sequence[BoardView]) -> StereoCalibration:
    """Calibrate each camera by itself (Zhang 2000), then both together with OpenCV's stereoCalibrate.

    The corners of a chessboard, which OpenCV numbers from either end, are numbered so that all views give the same pose
    of the cameras.  InputError for fewer than three views, views that do not determine the cameras (boards that hardly
    turn), or an RMS reprojection error of 5 px or more.
    """
    if len(views) < _FEWEST_VIEWS:
        expected = f"at least {_FEWEST_VIEWS}, better 10 or more"
        raise InputError("calibrate", f"the board is seen by both cameras in {len(views)} pairs; expected {expected}")
    corners, left_px, right_px = (
        [getattr(view, name) for view in views] for name in ("corners", "left_px", "right_px")
    )
    try:
        singles = [
            cv2.calibrateCameraExtended(corners, px, image_size, np.eye(3), np.zeros(5)) for px in (left_px, right_px)
        ]
        turns = [[_rotation(vector) for vector in single[3]] for single in singles]  # of the boards, by each camera
        turn_deg = min(map(_largest_turn_deg, turns))
        if turn_deg < _LEAST_TURN_DEG:
            problem = f"the board has nearly the same direction in all {len(views)} views (within {turn_deg:.1f}°)"
            raise InputError("calibrate", f"{problem}; expected some tilted by 20° or more to different sides")
        (_, K1, D1, *_), (_, K2, D2, *_) = singles
        is_reversed = _reversed_views(turns)
        right_px = [px[::-1].copy() if turned else px for px, turned in zip(right_px, is_reversed, strict=True)]
        views = [replace(view, right_px=px) for view, px in zip(views, right_px, strict=True)]
        flags = cv2.CALIB_USE_INTRINSIC_GUESS
        _, *matrices, _, _, rotations, shifts, _ = cv2.stereoCalibrateExtended(
            corners, left_px, right_px, K1, D1, K2, D2, image_size, np.eye(3), np.zeros(3), flags=flags
        )
    except cv2.error as error:
        raise InputError("calibrate", f"the views do not determine the cameras ({error.err}); add others") from error
    KL, DL, KR, DR, R, T = (np.array(matrix, dtype=float) for matrix in matrices)
    if not all(np.isfinite(matrix).all() for matrix in (KL, DL, KR, DR, R, T)):
        raise InputError("calibrate", "the views do not determine the cameras; add boards at other angles")
    residuals = []
    for view, turn, shift in zip(views, rotations, shifts, strict=True):
        in_left = view.corners @ _rotation(turn).T + np.array(shift, dtype=float).ravel()
        in_right = in_left @ R.T + T.ravel()
        residuals.append((view.left_px - _projected(in_left, KL, DL), view.right_px - _projected(in_right, KR, DR)))
    D = np.stack([DL.ravel()[:5], DR.ravel()[:5]])
    focal_std_px = np.array([single[5].ravel()[0] for single in singles])
    cameras = np.stack([KL, KR]), D, R, T.ravel(), focal_std_px
    calibration = StereoCalibration(image_size, *cameras, tuple(views), tuple(residuals))
    if (rms_px := calibration.rms_px) >= REFUSED_RMS_PX:
        worst = max(zip(views, residuals, strict=True), key=lambda item: _rms(np.concatenate(item[1])))[0].name
        expected = f"sharp views of one board by cameras that do not move to each other; {worst} fits worst"
        raise InputError("calibrate", f"the RMS reprojection error is {rms_px:.1f} px; expected below 1 px: {expected}")
    return calibration


def _reversed_views(turns: Sequence[Sequence[Array]]) -> list[bool]:
    """Whether the right corners of each view are numbered from the other end than the left ones.

    `turns`: rotations (3, 3) of the board in each view, of the left and of the right camera.  A board that is numbered
    from the other end is turned by 180°.  Of the two poses of the cameras by the first view that one is right which
    the other views agree with.
    """
    half_turn = np.diag([-1.0, -1.0, 1.0])
    poses = [[right @ turn @ left.T for turn in (np.eye(3), half_turn)] for left, right in zip(*turns, strict=True)]
    agreement = [np.array([[np.trace(pose.T @ first) for pose in both] for both in poses]) for first in poses[0]]
    best = max(agreement, key=lambda traces: traces.max(axis=1).sum())
    return [bool(kept < turned) for kept, turned in best]


def _rotation(vector: Any) -> Array:
    return np.array(cv2.Rodrigues(vector)[0], dtype=float)


def _largest_turn_deg(turns: Sequence[Array]) -> float:
    """Largest angle between the normals of two boards with these rotations (3, 3)."""
    normals = np.array([turn[:, 2] for turn in turns])
    return float(np.rad2deg(np.arccos(np.clip(np.min(normals @ normals.T), -1, 1))))


def _projected(points: Array, K: Array, D: Array) -> Array:
    """(n, 2) px of points (n, 3) in a camera's frame."""
    origin = np.zeros(3)
    return np.array(cv2.projectPoints(points, origin, origin, K, D)[0], dtype=float).reshape(-1, 2)


def _rms(residuals: Array) -> float:
    """Root mean square length of (n, 2) residuals."""
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))
