"""Baselines of the pipeline: two image trackers of OpenCV, two hue blobs, or one in a whole disparity map (SGBM).

All are told the true boxes in the first frame, and their points go through our Kalman filter.
"""

from typing import Literal, Protocol, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from pps_vision.experiments.baselines.image_trackers import BoxPx, HueModel, ImageTrackerName, image_tracker, middle
from pps_vision.geometry.camera import StereoRig, StereoView
from pps_vision.geometry.triangulation import midpoint
from pps_vision.types import Array, Image, Status, StereoFrame, Track3D
from tracking.kalman import Belief, KalmanParams, predict, scaled, start, update

StereoPipelineName = Literal["two hue blobs", "two CamShift", "two KCF", "two CSRT", "SGBM + blob"]
_DISPARITIES, _BLOCK_PX = 112, 5  # of SGBM
_POINT_STD_PX = 1.0  # what the filter is told of the baselines' centres: their boxes are whole pixels


class StereoPipeline(Protocol):
    """Follows one object in both eyes."""

    def start(self, frame: StereoFrame, boxes: tuple[BoxPx, BoxPx]) -> None:
        """Learn what is in the boxes, left and right."""

    def step(self, frame: StereoFrame) -> Array | None:
        """Its centre (3,) m in the root frame; None where it is lost."""
        ...


class TwoTrackers:
    """One image tracker an eye; the rays through the middles of their boxes meet at their midpoint."""

    def __init__(self, rig: StereoRig, name: ImageTrackerName) -> None:
        self._rig, self._eyes = rig, (image_tracker(name), image_tracker(name))

    def start(self, frame: StereoFrame, boxes: tuple[BoxPx, BoxPx]) -> None:
        """Learn what is in the boxes, left and right."""
        for eye, image, box in zip(self._eyes, (frame.left, frame.right), boxes, strict=True):
            eye.start(image, box)

    def step(self, frame: StereoFrame) -> Array | None:
        """None where an eye has lost it, or the rays do not meet before the eyes."""
        left, right = (eye.step(image) for eye, image in zip(self._eyes, (frame.left, frame.right), strict=True))
        return None if left is None or right is None else meet(self._rig.view_of(frame), left, right)


def meet(view: StereoView, left: BoxPx, right: BoxPx) -> Array | None:
    """(3,) where the rays through the middles of two boxes meet; None where they do not."""
    rays = [eye.rays(middle(box)) for eye, box in ((view.left, left), (view.right, right))]
    return midpoint(view.left.center, rays[0], view.right.center, rays[1])


class TwoHueBlobs:
    """The largest region of the object's hues in each eye; the rays through their centroids meet at their midpoint."""

    def __init__(self, rig: StereoRig) -> None:
        self._rig = rig
        self._models: tuple[HueModel, HueModel] | None = None

    def start(self, frame: StereoFrame, boxes: tuple[BoxPx, BoxPx]) -> None:
        """Learn the hues in the boxes, left and right."""
        self._models = HueModel(frame.left, boxes[0]), HueModel(frame.right, boxes[1])

    def step(self, frame: StereoFrame) -> Array | None:
        """None where an eye sees nothing of these hues, or the rays do not meet before the eyes."""
        if self._models is None:
            raise ValueError("step before start; the pipeline needs a first frame and boxes")
        view, rays = self._rig.view_of(frame), []
        for model, image, eye in zip(self._models, (frame.left, frame.right), (view.left, view.right), strict=True):
            blob = _largest(model.likelihood(image))
            if blob is None:
                return None
            seen = cv2.moments(blob.view(np.uint8), binaryImage=True)
            rays.append(eye.rays(np.array([seen["m10"], seen["m01"]]) / seen["m00"]))
        return midpoint(view.left.center, rays[0], view.right.center, rays[1])


class BlobInDisparity:
    """The textbook: rectify, SGBM over the whole image, the blob of the object's hues, its median disparity.

    That is taken for the centre's: a smooth ball has disparity at its rim only, which is as far as its centre.
    """

    def __init__(self, rig: StereoRig) -> None:
        self._rig = rig
        price = 3 * _BLOCK_PX**2  # of three channels: in grey, small objects drown in the background's disparity
        self._matcher = cv2.StereoSGBM.create(
            0, _DISPARITIES, _BLOCK_PX, 8 * price, 32 * price, uniquenessRatio=5, mode=cv2.StereoSGBM_MODE_SGBM_3WAY
        )
        self._model: HueModel | None = None

    def start(self, frame: StereoFrame, boxes: tuple[BoxPx, BoxPx]) -> None:
        """Learn the hues in the left box."""
        self._model = HueModel(frame.left, boxes[0])

    def step(self, frame: StereoFrame) -> Array | None:
        """None where the blob, or its disparity, is missing."""
        if self._model is None:
            raise ValueError("step before start; the pipeline needs a first frame and boxes")
        view = self._rig.view_of(frame)
        left, right, R_root_rect, Q = rectified(view, frame)
        blob = _largest(self._model.likelihood(left))
        if blob is None:
            return None
        disparity = np.asarray(self._matcher.compute(left, right), dtype=float) / 16
        known = disparity[blob & (disparity > 0)]
        if not len(known):
            return None
        v, u = (float(index.mean()) for index in np.nonzero(blob))
        x, y, z, w = Q @ np.array([u, v, float(np.median(known)), 1.0])
        center: Array = view.left.center + R_root_rect @ np.array([x, y, z]) / w
        return center


def rectified(view: StereoView, frame: StereoFrame) -> tuple[Image, Image, Array, Array]:
    """Both images with rows that match, the rectified left eye's axes in the root frame, and OpenCV's Q (4, 4)."""
    T_right_left = view.right.T_camera_root @ view.left.T_root_camera
    cameras = view.left.camera, view.right.camera
    size = cameras[0].width, cameras[0].height
    lens = [(camera.K, np.array(camera.distortion)) for camera in cameras]
    R1, R2, P1, P2, Q, _, _ = cv2.stereoRectify(*lens[0], *lens[1], size, T_right_left[:3, :3], T_right_left[:3, 3])
    images = []
    for image, (K, distortion), R, P in zip((frame.left, frame.right), lens, (R1, R2), (P1, P2), strict=True):
        u, v = cv2.initUndistortRectifyMap(K, distortion, R, P, size, cv2.CV_16SC2)
        images.append(np.asarray(cv2.remap(image, u, v, cv2.INTER_LINEAR), dtype=np.uint8))
    return images[0], images[1], view.left.T_root_camera[:3, :3] @ np.asarray(R1).T, np.asarray(Q)


def _largest(likelihood: NDArray[np.uint8]) -> NDArray[np.bool_] | None:
    """The largest connected region (H, W) that is more likely than not."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats((likelihood > 50).view(np.uint8))
    return None if count < 2 else np.asarray(labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


def stereo_pipeline(name: StereoPipelineName, rig: StereoRig) -> StereoPipeline:
    """A fresh pipeline; ValueError for another name."""
    if name not in get_args(StereoPipelineName):
        raise ValueError(f"pipeline {name!r}; expected one of {', '.join(get_args(StereoPipelineName))}")
    if name == "SGBM + blob":
        return BlobInDisparity(rig)
    if name == "two hue blobs":
        return TwoHueBlobs(rig)
    kind: dict[str, ImageTrackerName] = {"two CamShift": "CamShift", "two KCF": "KCF", "two CSRT": "CSRT"}
    return TwoTrackers(rig, kind[name])


class FilteredPipeline:
    """A pipeline's points through our own filter, so that a chart compares what comes before it.

    `start` with the first frame and the true boxes, then `step`; the track is lost after
    `lost_after_s` without a point, and known again with the next one.
    """

    def __init__(self, pipeline: StereoPipeline, rig: StereoRig, lost_after_s: float = 0.5) -> None:
        self._pipeline, self._rig, self._lost_after_s = pipeline, rig, lost_after_s
        self._params = KalmanParams()
        self._belief: Belief | None = None
        self._seen_s = -np.inf

    def start(self, frame: StereoFrame, boxes: tuple[BoxPx, BoxPx]) -> Track3D:
        """The track after the first frame."""
        self._pipeline.start(frame, boxes)
        self._belief = None
        view = self._rig.view_of(frame)
        return self._filter(view, meet(view, *boxes), frame.stamp_s)

    def step(self, frame: StereoFrame) -> Track3D:
        """The track after the next frame."""
        return self._filter(self._rig.view_of(frame), self._pipeline.step(frame), frame.stamp_s)

    def _filter(self, view: StereoView, point: Array | None, stamp_s: float) -> Track3D:
        if point is not None and (cov := _cov(view, point)) is not None:
            self._seen_s = stamp_s
            if self._belief is None:
                self._params = scaled(KalmanParams(), float(np.linalg.norm(point - view.left.center)))
                self._belief = start(self._params, stamp_s, point, cov)
            else:
                self._belief = update(self._params, predict(self._params, self._belief, stamp_s), point, cov)
            return self._track(self._belief, Status.TRACKING)
        if self._belief is None:
            return Track3D.unknown(stamp_s)
        if stamp_s - self._seen_s > self._lost_after_s:
            self._belief = None
            return Track3D.unknown(stamp_s, Status.LOST)
        self._belief = predict(self._params, self._belief, stamp_s)
        return self._track(self._belief, Status.COASTING)

    def _track(self, belief: Belief, status: Status) -> Track3D:
        order = self._params.order
        mean, cov = np.zeros((4, 3)), np.zeros((12, 12))
        mean[:order], cov[: 3 * order, : 3 * order] = belief.mean, belief.cov
        cov[:3, :3] += belief.correlated_cov
        return Track3D(belief.stamp_s, mean, cov, np.nan, np.nan, status)


def _cov(view: StereoView, point: Array) -> Array | None:
    """(3, 3) m² that pixel noise makes of a point; None where an eye cannot see it."""
    if not all(np.all(np.isfinite(eye.project(point))) for eye in (view.left, view.right)):
        return None
    J = np.concatenate([eye.project_jacobian(point) for eye in (view.left, view.right)])
    cov: Array = np.linalg.inv(J.T @ J) * _POINT_STD_PX**2
    return cov
