"""From a stereo pair and the object's masks to its place: outlines' centres, and disparity by several matchers."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.experiments.stereo_scenes import Scene
from pps_vision.geometry.camera import Camera, StereoView, View
from pps_vision.geometry.triangulation import triangulate
from pps_vision.types import Array, Image, Observation3D
from tracking.outline import Optics, Outline, cover, fit_outline

Grey = NDArray[np.uint8]
Matcher = Callable[[Grey, Grey, float], float | None]  # two patches, the object's middle's radius (px) → disparity
Method = Callable[[Scene], Array | None]
_REACH_PX = 8  # of the matchers in the region
_NEARER = 0.92  # of its radius: how much nearer than its centre the middle of a ball's surface is
_WHOLE_RANGE_PX = 96  # disparities of the whole image: 0.2 m away has 91


@dataclass(frozen=True, slots=True)
class Outlined:
    """Both outlines and the place (3,) their centres give."""

    left: Outline
    right: Outline
    seen: Observation3D


@cache
def _optics(camera: Camera) -> Optics:
    return Optics(camera)


def outlined(scene: Scene) -> Outlined | None:
    """What the outlines of the object's masks say."""
    shapes = []
    cameras = scene.view.left.camera, scene.view.right.camera
    for camera, image, mask in zip(cameras, (scene.frame.left, scene.frame.right), scene.masks, strict=True):
        shape = fit_outline(image, *mask, _optics(camera))
        if shape is None:
            return None
        shapes.append(shape)
    left, right = shapes
    found = triangulate(scene.view, left.center_px, right.center_px, left.cov_px, right.cov_px)
    if found is None:
        return None
    return Outlined(left, right, Observation3D(0.0, found.p_root, found.cov_root, 0.0, 0.0, found.residual_px))


def centroid(scene: Scene) -> Array | None:
    """The outlines' centres: mean directions, which no projection biases."""
    found = outlined(scene)
    return found.seen.p_root if found else None


def plain_centroid(scene: Scene) -> Array | None:
    """The mean pixel of the same coverage, as a ball's image were a disc about its centre."""
    middles = []
    for image, (mask, box) in zip((scene.frame.left, scene.frame.right), scene.masks, strict=True):
        alpha = cover(image, mask, box).alpha
        v, u = np.mgrid[box[1] : box[3], box[0] : box[2]]
        middles.append(np.array([(alpha * u).sum(), (alpha * v).sum()]) / alpha.sum())
    found = triangulate(scene.view, middles[0], middles[1], np.eye(2), np.eye(2))
    return found.p_root if found else None


def in_region(matcher: Matcher) -> Method:
    """Any matcher on the same parallel patches, about the surface where the outlines say it is."""

    def find(scene: Scene) -> Array | None:
        found = outlined(scene)
        if found is None:
            return None
        eye, theta = scene.view.left, found.left.angular_radius_rad
        ray = found.seen.p_root - eye.center
        surface = eye.center + ray * (1 - _NEARER * np.sin(theta))
        radius_px = 0.5 * theta * eye.camera.focal_px
        half = int(np.ceil(radius_px)) + 7
        patches = parallel_patches(
            scene.view, scene.frame.left, scene.frame.right, surface, (half + 2 * _REACH_PX, half)
        )
        disparity = matcher(patches.left, patches.right, radius_px)
        if disparity is None:
            return None
        nearer = 1 + disparity * patches.depth_m / (patches.focal_px * patches.baseline_m)
        return eye.center + ray / nearer if nearer > 0 else None

    return find


@dataclass(frozen=True)
class Patches:
    """Grey images (h, w) around one point as two parallel eyes would see it, that look across their
    baseline: the point is in the middle of both, so disparity 0 is its `depth_m`."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    depth_m: float
    focal_px: float
    baseline_m: float


def parallel_patches(view: StereoView, left: Image, right: Image, p_root: Array, half_size: tuple[int, int]) -> Patches:
    """Both RGB images to `half_size` (across, down) px around a point (3,), from eyes that are turned parallel."""
    line = view.right.center - view.left.center
    baseline = float(np.linalg.norm(line))
    x = line / baseline
    ahead = p_root - 0.5 * (view.left.center + view.right.center)
    z = ahead - (ahead @ x) * x
    z /= np.linalg.norm(z)
    R_root_rect = np.column_stack([x, np.cross(z, x), z])
    focal_px = view.left.camera.focal_px
    found = [
        _patch(i, eye, R_root_rect, p_root, half_size, focal_px) for i, eye in ((left, view.left), (right, view.right))
    ]
    depth = float((p_root - view.left.center) @ z)
    return Patches(found[0], found[1], depth, focal_px, baseline)


def _patch(
    image: Image, eye: View, R_root_rect: Array, p: Array, half_size: tuple[int, int], focal_px: float
) -> NDArray[np.uint8]:
    """Grey image around `p`, which lies in its middle, for an eye turned to `R_root_rect`."""
    x, y, z = R_root_rect.T @ (p - eye.center)
    across, down = half_size
    K = np.array([[focal_px, 0, across - focal_px * x / z], [0, focal_px, down - focal_px * y / z], [0, 0, 1]])
    R_rect_eye = R_root_rect.T @ eye.T_root_camera[:3, :3]
    distortion = np.array(eye.camera.distortion)
    maps = cv2.initUndistortRectifyMap(
        eye.camera.K, distortion, R_rect_eye, K, (2 * across + 1, 2 * down + 1), cv2.CV_16SC2
    )
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    return np.asarray(cv2.remap(grey, *maps, cv2.INTER_LINEAR), dtype=np.uint8)


def block(left: Grey, right: Grey, radius_px: float) -> float | None:
    """OpenCV's block matching."""
    matcher = cv2.StereoBM.create(2 * _REACH_PX, 9)
    matcher.setMinDisparity(-_REACH_PX)
    return _middle(np.asarray(matcher.compute(left, right)) / 16, radius_px, -_REACH_PX)


def semi_global(left: Grey, right: Grey, radius_px: float) -> float | None:
    """OpenCV's semi-global matching."""
    matcher = cv2.StereoSGBM.create(-_REACH_PX, 2 * _REACH_PX, 7, P1=8 * 49, P2=32 * 49, uniquenessRatio=5)
    return _middle(np.asarray(matcher.compute(left, right)) / 16, radius_px, -_REACH_PX)


def phase(left: Grey, right: Grey, radius_px: float) -> float | None:
    """Phase correlation of the two middles."""
    r, (cy, cx) = max(int(radius_px), 3), (np.array(left.shape) - 1) // 2
    window = np.s_[cy - r : cy + r + 1, cx - r : cx + r + 1]
    hann = cv2.createHanningWindow((2 * r + 1, 2 * r + 1), cv2.CV_32F)
    shift, response = cv2.phaseCorrelate(left[window].astype(np.float32), right[window].astype(np.float32), hann)
    return -float(shift[0]) if response > 0.1 else None


def whole_image(make: Callable[[], cv2.StereoMatcher]) -> Method:
    """Both images rectified from the known poses, one disparity map of all, its median on the object."""

    def find(scene: Scene) -> Array | None:
        return _from_map(scene, make())

    return find


def bm_whole() -> cv2.StereoMatcher:
    """OpenCV's block matching over the whole range."""
    return cv2.StereoBM.create(_WHOLE_RANGE_PX, 15)


def sgbm_whole() -> cv2.StereoMatcher:
    """OpenCV's semi-global matching over the whole range."""
    return cv2.StereoSGBM.create(0, _WHOLE_RANGE_PX, 5, P1=8 * 25, P2=32 * 25, uniquenessRatio=5)


def _from_map(scene: Scene, matcher: cv2.StereoMatcher) -> Array | None:
    view = scene.view
    left, right, P, R_rect_left = _rectified(view, scene.frame.left, scene.frame.right)
    disparity = np.asarray(matcher.compute(*(_padded(image) for image in (left, right))))[:, _WHOLE_RANGE_PX:] / 16
    toward = R_rect_left @ (view.left.T_root_camera[:3, :3].T @ (scene.p - view.left.center))  # stands for the blob's
    u, v = P[0, 0] * toward[:2] / toward[2] + P[:2, 2]
    distance = float(np.linalg.norm(toward))
    sine = scene.radius_m / distance
    rows, columns = np.mgrid[: disparity.shape[0], : disparity.shape[1]]
    near = (columns - u) ** 2 + (rows - v) ** 2 <= (0.5 * sine * P[0, 0]) ** 2
    good = disparity[near & (disparity > 0)]
    if len(good) < max(0.3 * np.count_nonzero(near), 5):
        return None
    baseline = float(np.linalg.norm(view.right.center - view.left.center))
    depth = P[0, 0] * baseline / float(np.median(good))
    ray = (scene.p - view.left.center) / distance
    return view.left.center + ray * depth * distance / toward[2] / (1 - _NEARER * sine)


def _rectified(view: StereoView, left: Image, right: Image) -> tuple[Grey, Grey, Array, Array]:
    """Both images as parallel eyes see them (OpenCV), their common projection and the left eye's turn."""
    a, b = view.left.camera, view.right.camera
    size = a.width, a.height
    T_right_left = view.right.T_camera_root @ view.left.T_root_camera
    lenses = np.array(a.distortion), np.array(b.distortion)
    R, t = T_right_left[:3, :3], T_right_left[:3, 3]
    R1, R2, P1, P2, *_ = cv2.stereoRectify(a.K, lenses[0], b.K, lenses[1], size, R, t, alpha=-1)
    found = []
    for image, camera, lens, turn, P in ((left, a, lenses[0], R1, P1), (right, b, lenses[1], R2, P2)):
        maps = cv2.initUndistortRectifyMap(camera.K, lens, turn, P, size, cv2.CV_16SC2)
        found.append(np.asarray(cv2.remap(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), *maps, cv2.INTER_LINEAR), np.uint8))
    return found[0], found[1], np.asarray(P1), np.asarray(R1)


def _padded(image: Grey) -> Grey:
    """With room on the left, where the matcher would else find nothing."""
    return np.asarray(cv2.copyMakeBorder(image, 0, 0, _WHOLE_RANGE_PX, 0, cv2.BORDER_REPLICATE), np.uint8)


def _middle(disparity: Array, radius_px: float, least: float) -> float | None:
    """The median within a radius of the middle; None where less than 30 % of it matched."""
    v, u = (np.mgrid[: disparity.shape[0], : disparity.shape[1]].T - (np.array(disparity.shape) - 1) / 2).T
    middle = u * u + v * v <= radius_px**2
    good = disparity[middle & (disparity >= least)]
    return float(np.median(good)) if len(good) >= max(0.3 * np.count_nonzero(middle), 5) else None


OURS = "centroid (ours)"
METHODS: dict[str, Method] = {
    OURS: centroid,
    "plain centroid": plain_centroid,
    "region SGBM": in_region(semi_global),
    "region BM": in_region(block),
    "region phase": in_region(phase),
    "whole BM": whole_image(bm_whole),
    "whole SGBM": whole_image(sgbm_whole),
}
