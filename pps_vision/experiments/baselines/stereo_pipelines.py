"""Baselines of the pipeline: two image trackers of OpenCV, two hue blobs, or one in a whole disparity map (SGBM).

All are given the true boxes in the first frame, and their points go through our Kalman filter.
"""

from collections.abc import Callable
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.experiments.baselines.image_trackers import (
    BoxPx,
    ImageTrackerName,
    Likelihood,
    hue_likelihood,
    image_tracker,
    middle,
)
from pps_vision.geometry.camera import StereoRig, StereoView, View
from pps_vision.geometry.triangulation import midpoint
from pps_vision.types import Array, Image, Status, StereoFrame, Track3D
from tracking.kalman import Belief, KalmanParams, predict, scaled, start, update

StereoPipelineName = Literal["two hue blobs", "two CamShift", "two KCF", "two CSRT", "SGBM + blob"]
StereoPipeline = Callable[[StereoFrame], Array | None]  # the object's centre (3,) m, root frame; None where it is lost
Boxes = tuple[BoxPx, BoxPx]
PixelOf = Callable[[Image], Array | None]  # (2,) px of the object in an image; None where it is lost
_DISPARITIES = 112  # of SGBM
_BLOCK_PX = 5
_POINT_STD_PX = 1.0  # of the baselines' centres, for the filter: their boxes are whole pixels


def stereo_pipeline(name: StereoPipelineName, rig: StereoRig, frame: StereoFrame, boxes: Boxes) -> StereoPipeline:
    """Return a pipeline that follows the object in the boxes of a frame; ValueError for another name."""
    if name not in get_args(StereoPipelineName):
        raise ValueError(f"pipeline {name!r}; expected one of {', '.join(get_args(StereoPipelineName))}")
    if name == "SGBM + blob":
        return _blob_in_disparity(rig, hue_likelihood(frame.left, boxes[0]))
    images = zip((frame.left, frame.right), boxes, strict=True)
    if name == "two hue blobs":
        return _in_both_eyes(rig, [_hue_blob(hue_likelihood(*pair)) for pair in images])
    kind: dict[str, ImageTrackerName] = {"two CamShift": "CamShift", "two KCF": "KCF", "two CSRT": "CSRT"}
    return _in_both_eyes(rig, [_box_middle(kind[name], *pair) for pair in images])


def _in_both_eyes(rig: StereoRig, eyes: list[PixelOf]) -> StereoPipeline:
    """The rays through the object's pixels meet at their midpoint; None where they do not meet before the eyes."""

    def step(frame: StereoFrame) -> Array | None:
        left, right = (eye(image) for eye, image in zip(eyes, (frame.left, frame.right), strict=True))
        return None if left is None or right is None else intersection(rig.view_of(frame), left, right)

    return step


def intersection(view: StereoView, left_px: Array, right_px: Array) -> Array | None:
    """Return the midpoint (3,) of the rays through two pixels; None where they do not meet before the eyes."""
    return midpoint(view.left.center, view.left.rays(left_px), view.right.center, view.right.rays(right_px))


def _box_middle(name: ImageTrackerName, image: Image, box: BoxPx) -> PixelOf:
    """The middle of an image tracker's box."""
    tracker = image_tracker(name, image, box)

    def pixel(image: Image) -> Array | None:
        tracked = tracker(image)
        return None if tracked is None else middle(tracked)

    return pixel


def _hue_blob(likelihood: Likelihood) -> PixelOf:
    """The centroid of the largest region of the object's hues."""

    def pixel(image: Image) -> Array | None:
        blob = _largest(likelihood(image))
        if blob is None:
            return None
        moments = cv2.moments(blob.view(np.uint8), binaryImage=True)
        return np.array([moments["m10"], moments["m01"]]) / moments["m00"]

    return pixel


def _blob_in_disparity(rig: StereoRig, likelihood: Likelihood) -> StereoPipeline:
    """The textbook: rectify, SGBM over the whole image, the blob of the object's hues, its median disparity.

    That is taken for the centre's: a smooth ball has disparity at its rim only, which is as far as its centre.
    """
    price = 3 * _BLOCK_PX**2  # of three channels: in grey, small objects drown in the background's disparity
    matcher = cv2.StereoSGBM.create(
        0, _DISPARITIES, _BLOCK_PX, 8 * price, 32 * price, uniquenessRatio=5, mode=cv2.StereoSGBM_MODE_SGBM_3WAY
    )

    def step(frame: StereoFrame) -> Array | None:
        view = rig.view_of(frame)
        left, right, R_root_rect, Q = rectified(view, frame)
        blob = _largest(likelihood(left))
        if blob is None:
            return None
        disparity = np.asarray(matcher.compute(left, right), dtype=float) / 16
        known = disparity[blob & (disparity > 0)]
        if not len(known):
            return None
        v, u = (float(index.mean()) for index in np.nonzero(blob))
        x, y, z, w = Q @ np.array([u, v, float(np.median(known)), 1.0])
        center: Array = view.left.center + R_root_rect @ np.array([x, y, z]) / w
        return center

    return step


def rectified(view: StereoView, frame: StereoFrame) -> tuple[Image, Image, Array, Array]:
    """Return both images with matching rows, the rectified left eye's axes in the root frame, and OpenCV's Q (4, 4)."""
    T_right_left = view.right.T_camera_root @ view.left.T_root_camera
    size = view.left.camera.width, view.left.camera.height
    lenses = [(eye.camera.K, np.array(eye.camera.distortion)) for eye in (view.left, view.right)]
    R1, R2, P1, P2, Q, _, _ = cv2.stereoRectify(*lenses[0], *lenses[1], size, T_right_left[:3, :3], T_right_left[:3, 3])
    images = []
    for image, lens, R, P in zip((frame.left, frame.right), lenses, (R1, R2), (P1, P2), strict=True):
        u, v = cv2.initUndistortRectifyMap(*lens, R, P, size, cv2.CV_16SC2)
        images.append(np.asarray(cv2.remap(image, u, v, cv2.INTER_LINEAR), dtype=np.uint8))
    return images[0], images[1], view.left.T_root_camera[:3, :3] @ np.asarray(R1).T, np.asarray(Q)


def _largest(likelihood: NDArray[np.uint8]) -> NDArray[np.bool_] | None:
    """The largest connected region (H, W) that is more likely than not."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats((likelihood > 50).view(np.uint8))
    return None if count < 2 else np.asarray(labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


class FilteredPipeline:
    """A pipeline's points through our own filter, so that a chart compares the stages before it.

    Begins with a frame and the true boxes, whose track is `first`; the track is lost after `lost_after_s` without a
    point, and known again with the next one.
    """

    def __init__(
        self, pipeline: StereoPipeline, rig: StereoRig, frame: StereoFrame, boxes: Boxes, lost_after_s: float = 0.5
    ) -> None:
        self._pipeline = pipeline
        self._rig = rig
        self._lost_after_s = lost_after_s
        self._params = KalmanParams()
        self._belief: Belief | None = None
        self._updated_s = -np.inf
        view = rig.view_of(frame)
        self.first = self._filter(view, intersection(view, *map(middle, boxes)), frame.stamp_s)

    def step(self, frame: StereoFrame) -> Track3D:
        """Return the track after the next frame."""
        return self._filter(self._rig.view_of(frame), self._pipeline(frame), frame.stamp_s)

    def _filter(self, view: StereoView, point: Array | None, stamp_s: float) -> Track3D:
        if point is not None and (cov := _cov((view.left, view.right), point)) is not None:
            self._updated_s = stamp_s
            if self._belief is None:
                self._params = scaled(KalmanParams(), float(np.linalg.norm(point - view.left.center)))
                self._belief = start(self._params, stamp_s, point, cov)
            else:
                self._belief = update(self._params, predict(self._params, self._belief, stamp_s), point, cov)
            return self._track(self._belief, Status.TRACKING)
        if self._belief is None:
            return Track3D.unknown(stamp_s)
        if stamp_s - self._updated_s > self._lost_after_s:
            self._belief = None
            return Track3D.unknown(stamp_s, Status.LOST)
        self._belief = predict(self._params, self._belief, stamp_s)
        return self._track(self._belief, Status.COASTING)

    def _track(self, belief: Belief, status: Status) -> Track3D:
        order = self._params.order
        mean = np.zeros((4, 3))
        mean[:order] = belief.mean
        cov = np.zeros((12, 12))
        cov[: 3 * order, : 3 * order] = belief.cov
        cov[:3, :3] += belief.correlated_cov
        return Track3D(belief.stamp_s, mean, cov, np.nan, np.nan, status)


def _cov(eyes: tuple[View, View], point: Array) -> Array | None:
    """(3, 3) m² of a point, from pixel noise; None where an eye cannot see it."""
    if not all(np.all(np.isfinite(eye.project(point))) for eye in eyes):
        return None
    J = np.concatenate([eye.project_jacobian(point) for eye in eyes])
    cov: Array = np.linalg.inv(J.T @ J) * _POINT_STD_PX**2
    return cov
