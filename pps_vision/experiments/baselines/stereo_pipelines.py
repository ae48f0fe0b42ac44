"""Baselines of the pipeline: two image trackers, given the true boxes in the first frame.

Their points go through our Kalman filter, so that a chart compares the stages before it.
"""

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np

from pps_vision.experiments.baselines.image_trackers import (
    BoxPx,
    ImageTrackerName,
    available,
    image_tracker,
    middle,
)
from pps_vision.geometry.camera import StereoRig, StereoView
from pps_vision.geometry.triangulation import midpoint
from pps_vision.types import Array, Image, Status, StereoFrame, Track3D
from tracking.kalman import Belief, KalmanParams, predict, scaled, start, update

StereoPipelineName = Literal["two hue blobs", "two CamShift", "two KCF", "two CSRT", "two NanoTrack"]
STEREO_PIPELINES: tuple[StereoPipelineName, ...] = get_args(StereoPipelineName)
Boxes = tuple[BoxPx, BoxPx]
PixelOf = Callable[[Image], Array | None]  # (2,) px of the object in the next image; None where it is lost
_POINT_STD_PX = 1.0  # error of the baselines' centres, for the filter: their boxes are whole pixels
_LOST_AFTER_S = 0.5  # without a point
_TRACKERS: dict[StereoPipelineName, ImageTrackerName] = {
    "two hue blobs": "hue blob",
    "two CamShift": "CamShift",
    "two KCF": "KCF",
    "two CSRT": "CSRT",
    "two NanoTrack": "NanoTrack",
}


def available_pipelines() -> tuple[StereoPipelineName, ...]:
    """Return all pipelines whose image tracker is available."""
    return tuple(name for name in STEREO_PIPELINES if _TRACKERS[name] in available())


def intersection(view: StereoView, left_px: Array, right_px: Array) -> Array | None:
    """Return the midpoint (3,) of the rays through two pixels; None where they do not meet before the eyes."""
    return midpoint(view.left.center, view.left.rays(left_px), view.right.center, view.right.rays(right_px))


def _follow(name: StereoPipelineName, image: Image, box: BoxPx) -> PixelOf:
    """Follow the middle of an image tracker's box."""
    tracker = image_tracker(_TRACKERS[name], image, box)

    def pixel(image: Image) -> Array | None:
        tracked = tracker(image)
        return None if tracked is None else middle(tracked)

    return pixel


class FilteredPipeline:
    """A pipeline's points through our own filter.

    The track is unknown before the frame at `first_s`, in which the true boxes are given; it is lost after
    0.5 s without a point, and known again with the next one.
    """

    def __init__(self, name: StereoPipelineName, rig: StereoRig, first_s: float, boxes: Boxes) -> None:
        self._name = name
        self._rig = rig
        self._first_s = first_s
        self._boxes = boxes
        self._eyes: list[PixelOf] = []
        self._params = KalmanParams()
        self._belief: Belief | None = None
        self._updated_s = -np.inf

    def step(self, frame: StereoFrame) -> Track3D:
        """Return the track after the next frame."""
        stamp_s = frame.stamp_s
        if stamp_s < self._first_s:
            return Track3D.unknown(stamp_s)
        view = self._rig.view_of(frame)
        point = self._point(frame, view)
        if point is not None and (cov := _cov(view, point)) is not None:
            self._updated_s = stamp_s
            if self._belief is None:
                self._params = scaled(KalmanParams(), float(np.linalg.norm(point - view.left.center)))
                self._belief = start(self._params, stamp_s, point, cov)
            else:
                self._belief = update(self._params, predict(self._params, self._belief, stamp_s), point, cov)
            return _track(self._belief, Status.TRACKING)
        if self._belief is None:
            return Track3D.unknown(stamp_s)
        if stamp_s - self._updated_s > _LOST_AFTER_S:
            self._belief = None
            return Track3D.unknown(stamp_s, Status.LOST)
        self._belief = predict(self._params, self._belief, stamp_s)
        return _track(self._belief, Status.COASTING)

    def _point(self, frame: StereoFrame, view: StereoView) -> Array | None:
        """(3,) m, root frame; None where an eye has lost the object."""
        images = (frame.left, frame.right)
        if self._eyes:
            left, right = (eye(image) for eye, image in zip(self._eyes, images, strict=True))
        else:
            self._eyes = [_follow(self._name, *pair) for pair in zip(images, self._boxes, strict=True)]
            left, right = map(middle, self._boxes)
        return None if left is None or right is None else intersection(view, left, right)


def _track(belief: Belief, status: Status) -> Track3D:
    cov = belief.cov.copy()
    cov[:3, :3] += belief.correlated_cov
    return Track3D(belief.stamp_s, belief.mean, cov, np.nan, np.nan, status)


def _cov(view: StereoView, point: Array) -> Array | None:
    """(3, 3) m² of a point, from pixel noise; None where an eye cannot see it."""
    eyes = (view.left, view.right)
    if not all(np.all(np.isfinite(eye.project(point))) for eye in eyes):
        return None
    J = np.concatenate([eye.project_jacobian(point) for eye in eyes])
    return np.asarray(np.linalg.inv(J.T @ J) * _POINT_STD_PX**2)
