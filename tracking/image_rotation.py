"""Rotation error of a camera's nominal pose, measured on the background.

Corners of a reference image are tracked to the current one by pyramidal Lucas–Kanade (Bouguet 2001) and compared with
their positions by the nominal poses.  The rotation that most corners share (iteratively reweighted least squares) is
the error of the nominal pose; corners on moving objects are outliers.
"""

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera, View, reduced_image
from pps_vision.jit import njit
from pps_vision.types import Array, Image, Mask

_WIDTH_PX = 320  # images are registered at about this width
_MAX_POINTS = 50  # corners of a reference image
_APART_PX = 16  # distance between corners
_QUALITY = 0.02  # strength of a corner relative to the strongest
_MIN_POINTS = 12  # number of corners that must agree
_MIN_SHARE = 0.5  # the same, as a share of the corners in view
_WINDOW_PX = 11  # Lucas–Kanade
_LEVELS = 3
_SAME_GAIN = 0.02  # of two images' brightness
_ROUNDS = 12  # maximum number of reweightings
_CUT_PX = (0.3, 1.5)  # smallest and largest scale of the robust weights
_PATCHES = (4, 8)  # pixels to each side of a corner that tell whether the image has moved: more where it is blurred
_NOISE = 3.0  # grey levels of the noise of a corner's shift, which must stay below `_STILL_PX`
_STILL_PX = 0.1  # median shift along either axis of corners at rest
_STILL_SPREAD_PX = 0.3  # median length of their shift

Grey = NDArray[np.uint8]


class Misalignment(NamedTuple):
    """`rotation` (3,) rad in the camera's frame: T_root_camera·exp(rotation) explains the image; its covariance `cov`
    (3, 3) rad²; and its derivative by the background's inverse distance, `by_parallax` (3,) rad·m."""

    rotation: Array
    cov: Array
    by_parallax: Array


class Reference:
    """Reference image: its corners and its pose."""

    def __init__(self, camera: Camera, image: Image, T_root_camera: Array) -> None:
        self._scale = max(1, round(camera.width / _WIDTH_PX))
        self._camera = camera.reduced(self._scale)
        self.T_root_camera = T_root_camera
        self._image = image
        self._grey = self._reduced(image)
        features = cv2.goodFeaturesToTrack(self._grey, _MAX_POINTS, _QUALITY, _APART_PX)
        corners = np.empty((0, 1, 2), np.float32) if features is None else np.asarray(features, np.float32)
        for patch in _PATCHES:
            self._keep_sharp(corners, patch)
            if self.has_corners:
                break
        self._bearings = self._camera.bearings(self._points[:, 0]) if len(self._points) else np.empty((0, 3))

    @property
    def has_corners(self) -> bool:
        """Whether there are enough corners to measure a rotation."""
        return len(self._points) >= _MIN_POINTS

    def is_still(self, image: Image) -> bool:
        """Whether most corners have not moved; much faster than `misalignment`."""
        if not self.has_corners:
            return False
        across, down, length = _median_shift(image, *self._pixels, self._before, self._solve)
        return max(abs(across), abs(down)) < _STILL_PX and length < _STILL_SPREAD_PX

    def misalignment(self, image: Image, view: View, room_m: float, guess: Array) -> Misalignment | None:
        """Return the error of an image's nominal pose relative to the reference's; None where too few corners agree.

        Args:
            image: RGB.
            view: Its nominal pose.
            room_m: Distance of most of the background.
            guess: (3,) initial value of the rotation, rad.
        """
        T = view.T_camera_root @ self.T_root_camera
        nominal = self._bearings @ T[:3, :3].T + T[:3, 3] / room_m
        nominal /= np.linalg.norm(nominal, axis=1, keepdims=True)
        start = self._camera.project(nominal @ np.asarray(cv2.Rodrigues(guess)[0]))
        in_view = self._in_view(start)
        if np.count_nonzero(in_view) < max(_MIN_POINTS, _MIN_SHARE * len(in_view)):
            return None
        positions, matched = self._follow(
            self._reduced(image), self._points[in_view], start[in_view, None].astype(np.float32)
        )
        if np.count_nonzero(matched) < _MIN_POINTS:
            return None
        measured = self._camera.bearings(positions[matched])
        cut = (_CUT_PX[0] / self._camera.focal_px, _CUT_PX[1] / self._camera.focal_px)
        fit = _fitted_rotation(nominal[in_view][matched], measured, guess, T[:3, 3].copy(), cut)
        agreeing = fit[3]
        if agreeing < max(_MIN_POINTS, _MIN_SHARE * np.count_nonzero(in_view)):
            return None
        return Misalignment(*fit[:3])

    def _reduced(self, image: Image) -> Grey:
        return np.asarray(cv2.cvtColor(reduced_image(image, self._scale), cv2.COLOR_RGB2GRAY), np.uint8)

    def _follow(self, grey: Grey, points: NDArray[np.float32], start: NDArray[np.float32]) -> tuple[NDArray[Any], Mask]:
        """Positions of the corners `points` (n, 1, 2) in another image, near `start`; mask of the tracked corners.

        Lucas–Kanade assumes constant brightness: if the gain has changed, the search is repeated in a corrected image.
        """
        positions, is_tracked = self._lucas_kanade(grey, points, start)
        reference_grey, current_grey = (cv2.blur(image, (_WINDOW_PX, _WINDOW_PX)) for image in (self._grey, grey))
        rows, columns = np.rint(points[is_tracked, 0]).astype(int).T[::-1]
        there_rows, there_columns = np.rint(positions[is_tracked]).astype(int).T[::-1]
        gain = (
            np.median((reference_grey[rows, columns] + 1.0) / (current_grey[there_rows, there_columns] + 1.0))
            if is_tracked.any()
            else 1.0
        )
        if abs(gain - 1) < _SAME_GAIN:
            return positions, is_tracked
        return self._lucas_kanade(np.asarray(cv2.convertScaleAbs(grey, alpha=float(gain)), np.uint8), points, start)

    def _lucas_kanade(
        self, grey: Grey, points: NDArray[np.float32], start: NDArray[np.float32]
    ) -> tuple[NDArray[Any], Mask]:
        positions, is_tracked, _ = cv2.calcOpticalFlowPyrLK(
            *(self._grey, grey, points, start.copy()),
            winSize=(_WINDOW_PX, _WINDOW_PX),
            maxLevel=_LEVELS - 1,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        return positions[:, 0], (is_tracked[:, 0] > 0) & self._in_view(positions[:, 0])

    def _in_view(self, pixels: NDArray[Any]) -> Mask:
        u, v = pixels.T
        inside: Mask = (u >= 0) & (v >= 0) & (u <= self._camera.width - 1) & (v <= self._camera.height - 1)
        return inside  # False for NaN

    def _keep_sharp(self, points: NDArray[np.float32], patch: int) -> None:
        """Keep the corners (n, 1, 2) whose patch of ± `patch` px determines a shift, and prepare `is_still`.

        `_pixels`: rows and columns (n, m) of the patches in the full image; `_before` (n, m): their grey levels;
        `_solve` (n, 2, m): maps a change of the levels to a shift in px.
        """
        k = self._scale
        m = patch + 1
        height, width = self._image.shape[:2]
        x, y = np.rint((points[:, 0] + 0.5) * k - 0.5).astype(int).T
        inside = (x >= m) & (y >= m) & (x < width - m) & (y < height - m)
        points, x, y = points[inside], x[inside], y[inside]
        down, across = np.mgrid[-m : m + 1, -m : m + 1]
        rows = y[:, None, None] + down
        columns = x[:, None, None] + across
        grey = self._image[rows, columns].mean(axis=3)
        slopes = 0.5 * np.stack(
            [grey[:, 1:-1, 2:] - grey[:, 1:-1, :-2], grey[:, 2:, 1:-1] - grey[:, :-2, 1:-1]], axis=1
        )
        slopes = slopes.reshape(len(points), 2, (2 * patch + 1) ** 2)
        slopes -= slopes.mean(axis=2, keepdims=True)  # a change of brightness is no shift
        normal = slopes @ slopes.transpose(0, 2, 1)
        sharp = np.linalg.eigvalsh(normal)[:, 0] > 2 * (_NOISE / _STILL_PX) ** 2
        self._points = points[sharp]
        self._solve = -np.linalg.solve(normal[sharp], slopes[sharp])
        rows, columns, self._before = (
            coordinates[sharp, 1:-1, 1:-1].reshape(-1, slopes.shape[2]) for coordinates in (rows, columns, grey)
        )
        self._pixels = rows, columns


@njit(cache=True, error_model="numpy")
def _median_shift(
    image: Image, rows: NDArray[np.int64], columns: NDArray[np.int64], levels: Array, solve: Array
) -> tuple[float, float, float]:
    """Medians over corners of the shift along x and y and of its length, px, as `Reference._keep_sharp` names them."""
    n, m = rows.shape
    shift = np.zeros((3, n))
    for i in range(n):
        for j in range(m):
            y = rows[i, j]
            x = columns[i, j]
            brighter = (float(image[y, x, 0]) + float(image[y, x, 1]) + float(image[y, x, 2])) / 3 - levels[i, j]
            shift[0, i] += solve[i, 0, j] * brighter
            shift[1, i] += solve[i, 1, j] * brighter
        shift[2, i] = math.hypot(shift[0, i], shift[1, i])
    return np.median(shift[0]), np.median(shift[1]), np.median(shift[2])


@njit(cache=True, error_model="numpy")
def _fitted_rotation(
    bearings: Array, measured: Array, guess: Array, shift: Array, cut: tuple[float, float]
) -> tuple[Array, Array, Array, int]:
    """Robust fit of the rotation vector w (3,) for which exp(w)ᵀ turns unit vectors `bearings` (n, 3) to `measured`.

    Returns w, its covariance (3, 3), its change if `shift` (3,) moves all points, and the number of inliers.  `cut` is
    the smallest and the largest scale (rad) of the Geman–McClure weights.
    """
    n = len(bearings)
    w = guess.copy()
    length = np.empty(n)
    weight = np.empty(n)
    middle = np.zeros(3)
    A = np.empty((3, 3))
    pulled = np.empty(3)
    moved = np.empty(3)
    scale = cut[0]
    for k in range(_ROUNDS):
        p = bearings @ _turn(w)
        for i in range(3):
            middle[i] = np.median(measured[:, i] - p[:, i]) if k == 0 else 0.0
        for i in range(n):
            length[i] = math.sqrt(((measured[i] - p[i] - middle) ** 2).sum())
        scale = min(max(2.5 * np.median(length), cut[0]), cut[1])
        A[:] = 0.0
        pulled[:] = 0.0
        moved[:] = 0.0
        for i in range(n):
            weight[i] = 1 / (1 + (length[i] / scale) ** 2) ** 2
            A += weight[i] * (np.eye(3) - np.outer(p[i], p[i]))
            pulled += weight[i] * np.cross(measured[i], p[i])
            moved += weight[i] * np.cross(shift, p[i])
        step = np.linalg.solve(A, pulled)
        w = w + step + 0.5 * np.cross(w, step)  # of two successive small rotations
        if k > 0 and np.abs(step).max() < 1e-7:
            break
    agreeing = 0
    total = 0.0
    for i in range(n):
        if length[i] < scale:
            agreeing += 1
            total += length[i] ** 2
    return w, total / max(2 * agreeing - 3, 1) * np.linalg.inv(A), np.linalg.solve(A, moved), agreeing


@njit(cache=True, error_model="numpy")
def _turn(w: Array) -> Array:
    """exp(w): rotation (3, 3) of a rotation vector (3,), Rodrigues' formula."""
    angle = math.sqrt((w**2).sum())
    s = math.sin(angle) / angle if angle > 1e-6 else 1.0
    t = (1 - math.cos(angle)) / angle**2 if angle > 1e-6 else 0.5
    K = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    return np.eye(3) + s * K + t * (K @ K)
