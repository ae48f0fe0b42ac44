"""Poses of the cameras: images warped between poses (`EgoMotion`), the rotation error of a nominal pose measured on the
background (`Reference`), and the poses of a rig that is declared fixed or of a head whose joints lag.

Corners of a reference image are tracked to the current one by pyramidal Lucas–Kanade (Bouguet 2001) and compared with
their positions by the nominal poses.  The rotation that most corners share (iteratively reweighted least squares) is
the error of the nominal pose; corners on moving objects are outliers.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.geometry.camera import Camera, StereoRig, StereoView, View, reduced_image
from pps_vision.geometry.masks import Box
from pps_vision.geometry.se3 import transform
from pps_vision.jit import njit
from pps_vision.types import Array, Image, Mask, StereoFrame

_WIDTH_PX = 320  # images are registered at about this width
_MAX_POINTS = 50  # corners of a reference image
_APART_PX = 16  # distance between corners
_QUALITY = 0.02  # strength of a corner relative to the strongest
_MIN_POINTS = 12  # number of corners that must agree
_MIN_SHARE = 0.5  # the same, as a share of the corners in view
_MEAN_PX = 31  # side of the square whose mean is taken off
_WINDOW_PX = 13  # of Lucas–Kanade
_ROUNDS = 12  # maximum number of reweightings
_CUT_PX = (0.3, 1.5)  # smallest and largest scale of the robust weights
_PATCH_PX = 8  # to each side of a corner, in which pixels tell whether the image has moved
_NOISE = 3.0  # grey levels of the noise of a corner's shift, which must stay below `_STILL_PX`
_STILL_PX = 0.1  # median shift along either axis of corners at rest; a smaller rotation is none
_STILL_SPREAD_PX = 0.3  # median length of their shift

Grey = NDArray[np.uint8]
ROOM_M = 1.2
"""Assumed distance of the static scene."""
_STEP = 8  # px between the nodes at which the warp is computed; between them it is smooth
_FAR_PX = np.float32(-1e4)  # pixel of a direction that the image does not contain
_STILL = 1e-5  # rad and m: far less than a hundredth of a pixel
ROOM_STD = 0.5  # 1/m: standard deviation of the background's inverse distance
_SAME_PX = 0.5  # largest difference of both cameras' rotations
_MEMORY_S = 1.0  # averaging time of the rotation rate and of the joints' jitter; a sure delay is measured after it
_RENEWED_S = 0.5  # a reference that does not match for this long is replaced
APART_S = 0.12  # time between the two images of a measurement of the delay
GAP_S = 0.25  # longest time between frames for a joint velocity
_DELAY_MEMORY_S = 10.0  # averaging time of the delay
_NOISE_PX = 0.05  # noise of a rotation between two images, per axis
_SCATTER_PRIOR = 6.0  # number of measured angles that the assumed noise is worth
_SURE_PX = 0.03  # a delay whose error shifts the image by less is sure
OwnBody = Callable[[Array, View], Mask]
"""Joints (rad) and the view of a camera → mask (H, W) of the robot's own body."""
Joints = tuple[Array, Array]  # (n,) rad, at the left and the right image


class Misalignment(NamedTuple):
    """`rotation` (3,) rad in the camera's frame: T_root_camera·exp(rotation) explains the image; its covariance `cov`
    (3, 3) rad²; and its derivative by the background's inverse distance, `by_parallax` (3,) rad·m."""

    rotation: Array
    cov: Array
    by_parallax: Array


class Reference:
    """Reference image: its corners and its pose."""

    def __init__(self, camera: Camera, image: Image, T_root_camera: Array, own_body: Mask | None = None) -> None:
        self._scale = max(1, round(camera.width / _WIDTH_PX))
        self._camera = _reduced(camera, self._scale)
        self.T_root_camera = T_root_camera
        self._grey = self._reduced(image)
        scene = None  # without corners of the robot's own body
        if own_body is not None:
            size = self._grey.shape[1], self._grey.shape[0]
            scene = np.asarray(cv2.resize((~own_body).view(np.uint8), size, interpolation=cv2.INTER_NEAREST))
        features = cv2.goodFeaturesToTrack(self._grey, _MAX_POINTS, _QUALITY, _APART_PX, mask=scene)
        corners = np.empty((0, 1, 2), np.float32) if features is None else np.asarray(features, np.float32)
        self._keep_sharp(image, corners)
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
        """The grey image without its local mean: Lucas–Kanade assumes constant brightness."""
        grey = cv2.cvtColor(reduced_image(image, self._scale), cv2.COLOR_RGB2GRAY)
        mean = cv2.blur(grey, (_MEAN_PX, _MEAN_PX))
        return np.asarray(cv2.addWeighted(grey, 1, mean, -1, 128), np.uint8)

    def _follow(self, grey: Grey, points: NDArray[np.float32], start: NDArray[np.float32]) -> tuple[NDArray[Any], Mask]:
        """Positions of the corners `points` (n, 1, 2) in another image, near `start`; mask of the tracked corners."""
        window = (_WINDOW_PX, _WINDOW_PX)
        positions, is_tracked, _ = cv2.calcOpticalFlowPyrLK(
            self._grey, grey, points, start.copy(), winSize=window, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
        )
        return positions[:, 0], (is_tracked[:, 0] > 0) & self._in_view(positions[:, 0])

    def _in_view(self, pixels: NDArray[Any]) -> Mask:
        u, v = pixels.T
        inside: Mask = (u >= 0) & (v >= 0) & (u <= self._camera.width - 1) & (v <= self._camera.height - 1)
        return inside  # False for NaN

    def _keep_sharp(self, image: Image, points: NDArray[np.float32]) -> None:
        """Keep the corners (n, 1, 2) whose patch of ± `_PATCH_PX` determines a shift, and prepare `is_still`.

        `_pixels`: rows and columns (n, m) of the patches in the full image; `_before` (n, m): their grey levels;
        `_solve` (n, 2, m): maps a change of the levels to a shift in px.
        """
        k = self._scale
        m = _PATCH_PX + 1
        height, width = image.shape[:2]
        x, y = np.rint((points[:, 0] + 0.5) * k - 0.5).astype(int).T
        inside = (x >= m) & (y >= m) & (x < width - m) & (y < height - m)
        points, x, y = points[inside], x[inside], y[inside]
        down, across = np.mgrid[-m : m + 1, -m : m + 1]
        rows = y[:, None, None] + down
        columns = x[:, None, None] + across
        grey = image[rows, columns].mean(axis=3)
        slopes = 0.5 * np.stack(
            [grey[:, 1:-1, 2:] - grey[:, 1:-1, :-2], grey[:, 2:, 1:-1] - grey[:, :-2, 1:-1]], axis=1
        )
        slopes = slopes.reshape(len(points), 2, (2 * _PATCH_PX + 1) ** 2)
        slopes -= slopes.mean(axis=2, keepdims=True)  # a change of brightness is no shift
        normal = slopes @ slopes.transpose(0, 2, 1)
        sharp = np.linalg.eigvalsh(normal)[:, 0] > 2 * (_NOISE / _STILL_PX) ** 2
        self._points = points[sharp]
        self._solve = -np.linalg.solve(normal[sharp], slopes[sharp])
        rows, columns, self._before = (
            coordinates[sharp, 1:-1, 1:-1].reshape(-1, slopes.shape[2]) for coordinates in (rows, columns, grey)
        )
        self._pixels = rows, columns


@lru_cache(maxsize=8)
def _reduced(camera: Camera, scale: int) -> Camera:
    """`camera.reduced(scale)`, always the same instance, which keeps its lens's tables."""
    return camera.reduced(scale)


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
    w = guess.copy()
    scale = cut[0]
    for k in range(_ROUNDS):
        p = bearings @ _turn(w)
        off = measured - p
        middle = np.array([np.median(off[:, i]) if k == 0 else 0.0 for i in range(3)])
        length = np.sqrt(((off - middle) ** 2).sum(axis=1))
        scale = min(max(2.5 * np.median(length), cut[0]), cut[1])
        weight = 1 / (1 + (length / scale) ** 2) ** 2
        weighted = p * weight.reshape(-1, 1)
        A = weight.sum() * np.eye(3) - weighted.T @ p
        step = np.linalg.solve(A, np.cross(measured, weighted).sum(axis=0))
        w = w + step + 0.5 * np.cross(w, step)  # of two successive small rotations
        if k > 0 and np.abs(step).max() < 1e-7:
            break
    is_near = length < scale
    variance = (length[is_near] ** 2).sum() / max(2 * is_near.sum() - 3, 1)
    by_shift = np.linalg.solve(A, np.cross(shift, weighted.sum(axis=0)))
    return w, variance * np.linalg.inv(A), by_shift, is_near.sum()


@njit(cache=True, error_model="numpy")
def _turn(w: Array) -> Array:
    """exp(w): rotation (3, 3) of a rotation vector (3,), Rodrigues' formula."""
    angle = math.sqrt((w**2).sum())
    s = math.sin(angle) / angle if angle > 1e-6 else 1.0
    t = (1 - math.cos(angle)) / angle**2 if angle > 1e-6 else 0.5
    K = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    return np.eye(3) + s * K + t * (K @ K)


class EgoMotion:
    """Warps images of one camera between its poses.

    The effect of a translation depends on the scene's distance, which is unknown: the caller gives the inverse distance
    (1/m; 0 is infinity) of the points that shall coincide.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera

    @cached_property
    def _nodes(self) -> Array:
        """(rows, columns, 3) directions of a grid of pixels that reaches one cell beyond the image."""
        columns = -(-self.camera.width // _STEP) + 2
        rows = -(-self.camera.height // _STEP) + 2
        v, u = np.mgrid[:rows, :columns] * _STEP - _STEP + (_STEP - 1) / 2
        return self.camera.bearings(np.stack([u, v], axis=-1))

    @staticmethod
    def is_still(earlier: View, current: View) -> bool:
        """Whether both poses are equal."""
        return earlier is current or bool((np.abs(earlier.T_root_camera - current.T_root_camera) < _STILL).all())

    def parallax_px_m(self, earlier: View, current: View) -> float:
        """Parallax in the earlier image (px) per 1/m of inverse distance."""
        return self.camera.focal_px * float(np.linalg.norm(current.center - earlier.center))

    def project(self, directions: Array, earlier: View, current: View, inverse_distance: float) -> Array:
        """Pixels (…, 2) in the earlier view of directions (…, 3) of the current one; NaN where it does not
        contain them."""
        T_earlier_current = earlier.T_camera_root @ current.T_root_camera
        points = directions @ T_earlier_current[:3, :3].T + inverse_distance * T_earlier_current[:3, 3]
        return self.camera.project(points)

    def maps(
        self, earlier: View, current: View, inverse_distance: float, box: Box | None = None
    ) -> NDArray[np.float32]:
        """Pixels (y1 − y0, x1 − x0, 2) in the earlier view of the pixels of `box` (None: of all) in the current one;
        far outside the image where the earlier view does not contain them."""
        x0, y0, x1, y1 = box or (0, 0, self.camera.width, self.camera.height)
        first_row = y0 // _STEP
        first_column = x0 // _STEP
        cells = np.s_[first_row : -(-y1 // _STEP) + 2, first_column : -(-x1 // _STEP) + 2]
        nodes = self.project(self._nodes[cells], earlier, current, inverse_distance).astype(np.float32)
        nodes[np.isnan(nodes)] = _FAR_PX
        rows, columns = nodes.shape[:2]
        whole = cv2.resize(nodes, (columns * _STEP, rows * _STEP), interpolation=cv2.INTER_LINEAR)
        top = y0 - _STEP * first_row + _STEP
        left = x0 - _STEP * first_column + _STEP
        return np.asarray(whole[top : top + y1 - y0, left : left + x1 - x0], dtype=np.float32)

    def warp(
        self, image: NDArray[np.uint8], earlier: View, current: View, inverse_distance: float, box: Box | None = None
    ) -> NDArray[np.uint8]:
        """The earlier image (H, W) or (H, W, 3) warped to the current view, or its `box`; 0 where unknown."""
        maps = self.maps(earlier, current, inverse_distance, box)
        return np.asarray(cv2.remap(image, maps, np.empty(0), cv2.INTER_LINEAR), np.uint8)


def channel_maximum(levels: NDArray[Any]) -> NDArray[np.uint8]:
    """Largest of the three channels (h, w)."""
    red, green, blue = cv2.split(levels)
    return np.asarray(cv2.max(cv2.max(red, green), blue), np.uint8)


def color_difference(colors: NDArray[np.float32], points: Array, image: NDArray[np.uint8], view: View) -> float:
    """Mean absolute difference (grey levels) between the colours (n, 3) of points (n, 3; root frame) and their colours
    in an image (H, W, 3) of `view` (0 outside of it)."""
    pixels = view.project(points).astype(np.float32)
    sampled = cv2.remap(image, pixels[None], np.empty(0), cv2.INTER_LINEAR)[0]
    return float(np.abs(sampled - colors).mean())


class CameraPoses(NamedTuple):
    """Poses of both cameras.

    `stamp_error_s` is the standard deviation of the time between images and joints, `rotation_std_rad` that of the
    rotation about each axis. `is_known` is False where the cameras move and the images do not determine the motion.
    """

    view: StereoView
    stamp_error_s: float = 0.0
    rotation_std_rad: float = 0.0
    is_known: bool = True


@dataclass(frozen=True, slots=True)
class CameraMotion:
    """Estimated error of the nominal poses: rotation (3,) since the first frame of a rig that is declared fixed (rad,
    root frame) and its rate (rad/s, mean of the last second); lag of the joints and its standard deviation (s).

    `is_seen` is False where the cameras are declared fixed and the images show nothing that could tell it.
    """

    rotation_rad: Array
    rate_rad_s: float
    delay_s: float
    delay_std_s: float
    is_seen: bool = True


class PoseEstimator:
    """Estimates the poses of the cameras; `step` takes frames in the order of their stamps.

    Args:
        rig: The cameras, and their nominal poses.
        stamp_error_s: Standard deviation of the time by which joints are late, before any image; 0: never.
        own_body: Masks the robot's own body, which is no scene; None: it is not seen.
    """

    def __init__(self, rig: StereoRig, stamp_error_s: float, own_body: OwnBody | None = None) -> None:
        self._rig = rig
        self._fixed = _FixedRig()
        self._late = _LateJoints(rig, stamp_error_s, own_body) if stamp_error_s > 0 else None

    def step(self, frame: StereoFrame) -> CameraPoses:
        """The poses at which the images of a frame were taken."""
        nominal = self._rig.view_of(frame)
        joints = frame.joints_left_rad, frame.joints_right_rad
        if joints[0] is None or joints[1] is None:
            return self._fixed.step(frame, nominal)
        return self._late.step(frame, nominal, (joints[0], joints[1])) if self._late else CameraPoses(nominal)

    def nominal(self, frame: StereoFrame) -> CameraPoses:
        """The nominal poses, for a frame with a blank image."""
        return CameraPoses(self._rig.view_of(frame))

    @property
    def motion(self) -> CameraMotion:
        """Error of the nominal poses at the last frame."""
        delay = (self._late.delay_s, self._late.std_s) if self._late else (0.0, math.nan)
        return CameraMotion(self._fixed.rotation.copy(), self._fixed.rate_rad_s, *delay, self._fixed.is_seen)


class _FixedRig:
    """Rotation of a rig that is declared fixed, relative to its first image.

    The rotation of the first image from the nominal pose is unknown; its variance is that of the jitter from image to
    image.  Both cameras must turn equally.  The first image stays the reference while half of its corners are in view,
    so that a rig that swings back does not drift; else the last image that replaced it.
    """

    def __init__(self) -> None:
        self.rotation: Array = np.zeros(3)
        self.rate_rad_s = 0.0
        self._n_changes = 0
        self._changes_rad2 = 0.0  # sum of the squared changes of the rotation
        self._error_rad2 = 0.0
        self._known_s = -math.inf
        self._renewed_s = -math.inf
        self._references: list[tuple[Reference, Reference]] = []

    @property
    def is_seen(self) -> bool:
        """Whether an image has shown corners by which a rotation is measured; True before the first."""
        return not self._references or any(eye.has_corners for pair in self._references for eye in pair)

    def step(self, frame: StereoFrame, nominal: StereoView) -> CameraPoses:
        images = (frame.left, frame.right)
        stamp_s = frame.stamp_s
        if not self.is_seen and stamp_s - self._renewed_s > _RENEWED_S:
            self._references.clear()
        if not self._references:
            self._renew(images, nominal, stamp_s)
        rotation = self._measured(images, nominal)
        if rotation is None:
            if stamp_s - self._known_s > _RENEWED_S:
                self._renew(images, nominal, stamp_s)
            return CameraPoses(_turned(nominal, self.rotation), is_known=False)
        dt_s = stamp_s - self._known_s
        if dt_s > 0:
            share = min(dt_s / _MEMORY_S, 1.0)
            self.rate_rad_s += share * (math.dist(rotation, self.rotation) / dt_s - self.rate_rad_s)
            self._n_changes += 1
            self._changes_rad2 += math.dist(rotation, self.rotation) ** 2
        self.rotation = rotation
        self._known_s = stamp_s
        first_rad2 = self._changes_rad2 / max(self._n_changes, 1) / 6  # a change is of two images, about three axes
        std_rad = math.sqrt(first_rad2 + self._error_rad2)
        return CameraPoses(_turned(nominal, self.rotation), rotation_std_rad=std_rad)

    def _renew(self, images: tuple[Image, Image], nominal: StereoView, stamp_s: float) -> None:
        """Make the current images the last reference."""
        view = _turned(nominal, self.rotation)
        left, right = (
            Reference(eye.camera, image, eye.T_root_camera)
            for eye, image in zip((view.left, view.right), images, strict=True)
        )
        self._references[1:] = [(left, right)]
        self._known_s = self._renewed_s = stamp_s

    def _measured(self, images: tuple[Image, Image], nominal: StereoView) -> Array | None:
        """Rotation (3,) rad, root frame; None if it is unknown."""
        first = zip(self._references[0], images, strict=True)
        if all(reference.is_still(image) for reference, image in first if reference.has_corners):
            self._error_rad2 = 0.0
            return np.zeros(3)
        for references in self._references:
            rotations = []
            error_rad2 = 0.0
            for reference, image, eye in zip(references, images, (nominal.left, nominal.right), strict=True):
                R = eye.T_root_camera[:3, :3]
                misalignment = reference.misalignment(image, eye, ROOM_M, R.T @ self.rotation)
                if misalignment is not None:
                    rotations.append(R @ misalignment.rotation)
                    error_rad2 += float(np.trace(misalignment.cov)) / 3
            focal_px = nominal.left.camera.focal_px
            if rotations and math.dist(rotations[0], rotations[-1]) < _SAME_PX / focal_px:
                rotation: Array = np.mean(rotations, axis=0)
                self._error_rad2 = error_rad2 / len(rotations) ** 2
                return rotation if math.hypot(*rotation) > _STILL_PX / focal_px else np.zeros(3)
        return None


def _turned(nominal: StereoView, rotation: Array) -> StereoView:
    """The view turned by a rotation vector (3,) about the midpoint of the cameras."""
    if not rotation.any():
        return nominal
    R = np.asarray(cv2.Rodrigues(rotation)[0], float)
    T = transform(R, nominal.midpoint - R @ nominal.midpoint)
    left, right = (View(view.camera, T @ view.T_root_camera) for view in (nominal.left, nominal.right))
    return StereoView(left, right)


class JointClock:
    """Delay of the joints behind the images, from rotations of the cameras between images, one by one.

    Joints that lag by τ cause a rotation error τ·ω.  The background in two images of a camera shows the change of that
    error; its inverse distance is estimated too, by recursive least squares.  The scatter of the measurements scales
    the covariance.

    Args:
        focal_px: Focal length.
        prior_std: (k,) standard deviations of the coefficients of the delay, s, before any image.
        memory_s: Averaging time.
    """

    def __init__(self, focal_px: float, prior_std: Sequence[float], memory_s: float = math.inf) -> None:
        self._noise_rad2 = (_NOISE_PX / focal_px) ** 2
        self._prior = np.diag(np.array([*prior_std, ROOM_STD]) ** -2)
        self._memory_s = memory_s
        self._information = np.zeros_like(self._prior)
        self._pull = np.zeros(len(self._prior))
        self._scatter = _SCATTER_PRIOR  # sum of the squared normalised misfits
        self._scattered = _SCATTER_PRIOR  # their number
        self.measured_s = -math.inf
        self.n = 0

    @property
    def estimate(self) -> tuple[Array, Array]:
        """Coefficients (k,) of the delay and their covariance (k, k)."""
        cov = np.linalg.inv(self._prior + self._information)
        return (cov @ self._pull)[:-1], self._scatter / self._scattered * cov[:-1, :-1]

    def update(self, stamp_s: float, measured: Misalignment, by_delay: Array) -> float:
        """Update by the rotation error between two images, whose derivatives by the coefficients are `by_delay` (3, k).

        Returns the part of its mean square about an axis, rad², that neither they nor the noise explain.
        """
        X = np.column_stack([by_delay, measured.by_parallax])
        noise = measured.cov + self._noise_rad2 * np.eye(3)
        W = np.linalg.inv(noise)
        keep = math.exp(-min((stamp_s - self.measured_s) / self._memory_s, 1.0)) if self.n else 0.0
        self._information = keep * self._information + X.T @ W @ X
        self._pull = keep * self._pull + X.T @ W @ measured.rotation
        misfit = measured.rotation - X @ np.linalg.solve(self._prior + self._information, self._pull)
        self._scatter = _SCATTER_PRIOR + keep * (self._scatter - _SCATTER_PRIOR) + float(misfit @ W @ misfit)
        self._scattered = _SCATTER_PRIOR + keep * (self._scattered - _SCATTER_PRIOR) + 3
        self.measured_s = stamp_s
        self.n += 1
        return (float(misfit @ misfit) - float(np.trace(noise))) / 3


class _LateJoints:
    """Lag of the joints behind the images (`JointClock`); a frame's joints are extrapolated by it.

    A priori the joints are exact or late, each with probability ½; the delay and its variance are the mean and the
    variance of this mixture.
    """

    def __init__(self, rig: StereoRig, prior_std_s: float, own_body: OwnBody | None) -> None:
        self._rig = rig
        self._own_body = own_body
        self._prior_std_s = prior_std_s
        self._clock = JointClock(rig.left.focal_px, (prior_std_s,), _DELAY_MEMORY_S)
        self._misfit_rad2 = 0.0
        self._past: deque[tuple[float, StereoView, Joints]] = deque(maxlen=3)
        self._reference: tuple[Reference, Array, float] | None = None  # with the angular velocity and the stamp
        self._eye = 0
        self.delay_s = 0.0
        self.std_s = prior_std_s

    def step(self, frame: StereoFrame, nominal: StereoView, joints: Joints) -> CameraPoses:
        if self._past and frame.stamp_s - self._past[-1][0] > GAP_S:
            self._past.clear()
            self._reference = None
        self._past.append((frame.stamp_s, nominal, joints))
        if len(self._past) < 3:
            return CameraPoses(nominal, self.std_s, self._rotation_std_rad)
        self._measure(frame, nominal)
        left, right = (self._extrapolated([joints[eye] for _, _, joints in self._past]) for eye in (0, 1))
        return CameraPoses(self._rig.view(left, right), self.std_s, self._rotation_std_rad)

    @property
    def _rotation_std_rad(self) -> float:
        """Rotation error of one image that neither the delay nor the measurement noise explains."""
        return math.sqrt(0.5 * max(self._misfit_rad2, 0.0))

    def _times(self) -> tuple[float, float]:
        """Times between the last three frames, s."""
        a, b, c = (stamp_s for stamp_s, _, _ in self._past)
        return b - a, c - b

    def _extrapolated(self, joints: list[Array]) -> Array:
        """Joints (n,) after the delay, at constant acceleration."""
        h, k = self._times()
        a, b, c = joints
        t = self.delay_s
        last_rate = (c - b) / k
        acceleration = (last_rate - (b - a) / h) / (h + k)
        extrapolated: Array = c + t * last_rate + acceleration * t * (k + t)
        return extrapolated

    def _rate(self, eye: int) -> Array:
        """(3,) rad/s: nominal angular velocity of an eye in its own frame, at the last frame."""
        h, k = self._times()
        a, b, c = ((view.left, view.right)[eye].T_root_camera[:3, :3] for _, view, _ in self._past)
        first_rate = cv2.Rodrigues(a.T @ b)[0].ravel() / h
        last_rate = cv2.Rodrigues(b.T @ c)[0].ravel() / k
        return np.asarray(last_rate + (last_rate - first_rate) / (h + k) * k, float)

    def _measure(self, frame: StereoFrame, nominal: StereoView) -> None:
        """Compare an image with an earlier one, alternately for the left and the right camera."""
        stamp_s = frame.stamp_s
        view, image = ((nominal.left, frame.left), (nominal.right, frame.right))[self._eye]
        if self._reference is not None:
            reference, rate_then, then_s = self._reference
            if stamp_s - then_s < APART_S - 1e-6:
                return
            turned = view.T_camera_root[:3, :3] @ reference.T_root_camera[:3, :3]
            change = self._rate(self._eye) - turned @ rate_then
            misalignment = reference.misalignment(image, view, ROOM_M, self.delay_s * change)
            if misalignment is not None:
                self._update(misalignment, change, stamp_s)
            self._reference = None
            self._eye = 1 - self._eye
            return
        rate = self._rate(self._eye)
        is_sure = self.std_s * math.hypot(*rate) * view.camera.focal_px < _SURE_PX
        if is_sure and stamp_s - self._clock.measured_s < _MEMORY_S:
            return
        joints = self._past[-1][2][self._eye]
        own_body = None if self._own_body is None else self._own_body(joints, view)
        self._reference = (Reference(view.camera, image, view.T_root_camera, own_body), rate, stamp_s)

    def _update(self, measured: Misalignment, change: Array, stamp_s: float) -> None:
        """Update the delay by a rotation: the delay times a `change` (3,) of angular velocity, plus parallax."""
        elapsed_s = stamp_s - self._clock.measured_s
        beyond_rad2 = self._clock.update(stamp_s, measured, change[:, None])
        self._misfit_rad2 += (beyond_rad2 - self._misfit_rad2) * min(elapsed_s / _MEMORY_S, 1.0)
        (late_s,), cov = self._clock.estimate
        self.delay_s, self.std_s = exact_or_late(float(late_s), float(cov[0, 0]), self._prior_std_s)


def exact_or_late(late_s: float, late_var_s2: float, prior_std_s: float) -> tuple[float, float]:
    """Mean and standard deviation (s) of a delay that is 0 with probability ½, else normal about 0 with `prior_std_s`.

    `late_s` and `late_var_s2` are its mean and variance if it is not 0.  The odds of 0 are the ratio of posterior and
    prior density there (Dickey 1971).
    """
    odds = prior_std_s / math.sqrt(late_var_s2) * math.exp(-0.5 * late_s**2 / late_var_s2)
    is_late = 1 / (1 + odds)
    delay_s = is_late * late_s
    return delay_s, math.sqrt(is_late * (late_var_s2 + late_s**2) - delay_s**2)
