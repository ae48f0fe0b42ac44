"""From two images to one point: our triangulation beside OpenCV's and beside a disparity map.

A plain and a textured ball of 35 mm, 0.4 m from the eyes, while the head sways. The error counts before any filter; the
disparity map is given the ball's direction.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np

from pps_vision.experiments.baselines.stereo_pipelines import intersection
from pps_vision.experiments.charts import cells_chart
from pps_vision.experiments.films.ray_cast_eyes import chequered_ball
from pps_vision.experiments.films.recordings import EYES_M, Footage, film, follow, watching
from pps_vision.experiments.films.score import steps_of
from pps_vision.experiments.study import NOISE_SIGMA, TURNS, Method, Metric, SceneSource, Values, compare, rms
from pps_vision.experiments.timing import timed_steps
from pps_vision.geometry.camera import StereoView
from pps_vision.geometry.triangulation import triangulate
from pps_vision.robot.icub import load_icub
from pps_vision.types import Array, Detection2D, Image, StereoFrame
from rendering.motions import Circle
from rendering.sensor import Sensor
from rendering.stimuli import RED, make_stimulus

BALL_M = 0.035
_SECOND_COLOR = (127 / 255 * RED[0], RED[1], RED[2])  # textured ball
OURS = "covariance (ours)"
BASELINES = ("midpoint", "linear (OpenCV)", "whole BM")
_SECONDS = 1.5
_SETTLED = 10  # first frame that counts
_DISTANCE_M = 0.4
_RANGE_PX = 96  # disparities that are searched: at 0.2 m an iCub's rectified eyes have 91
_NEARER = 0.92  # of its radius: distance from the centre of a ball to the middle of its visible surface
_METRICS = {"rms_mm": Metric("error_mm", rms)}


class Pair(NamedTuple):
    """A stereo pair, its view, the tracker's detections in it, and the ball's true position."""

    frame: StereoFrame
    view: StereoView
    left: Detection2D
    right: Detection2D
    p: Array


chart = cells_chart("rms_mm", "3D RMS error, 0.4 m (mm)", BASELINES, OURS)


def run(study: Any) -> dict[str, Any]:
    """Return by scenes and method: 3D error, time."""
    scenarios = study.scenarios(_pairs, ("plain ball", "textured ball"))
    return {"cells": compare(scenarios, methods(), _METRICS, study.seeds, "midpoint", TURNS)}


def _pairs(ball: str, source: SceneSource, seed: int) -> list[Pair]:
    rng = np.random.default_rng(seed)
    plane = np.linalg.qr(rng.standard_normal((3, 3)))[0][:2]
    center = EYES_M + _DISTANCE_M * np.array([-1.0, *rng.uniform(-0.1, 0.1, 2)])
    states = watching(Circle(center, plane, 0.03, 0.1), _SECONDS, follow(load_icub()))
    stimulus = make_stimulus("ball", BALL_M)
    if ball == "textured ball":
        stimulus = replace(stimulus, parts=chequered_ball(BALL_M, RED, _SECOND_COLOR))
    recording = film(states, stimulus, source, Sensor(noise_sigma=NOISE_SIGMA), seed)
    return list(detected_pairs(recording, seed))


def detected_pairs(recording: Footage, seed: int) -> Iterator[Pair]:
    """Yield the pairs in which the tracker detects the ball in both images, from frame 10 on."""
    steps, _ = steps_of(recording, seed)
    for k, (frame, step) in enumerate(zip(recording.frames, steps, strict=True)):
        if k >= _SETTLED and len(step.detections) == 2:
            left, right = step.detections
            yield Pair(frame, recording.rig.view_of(frame), left, right, recording.position[k])


def methods() -> dict[str, Method]:
    """Return the methods from a pair to a point, by name."""

    def pixels(triangulation: Callable[[StereoView, Array, Array], Array | None]) -> Method:
        return partial(_run, lambda pair: triangulation(pair.view, pair.left.center_px, pair.right.center_px))

    return {
        OURS: partial(_run, _ours),
        "midpoint": pixels(intersection),
        "linear (OpenCV)": pixels(_linear),
        "whole BM": partial(_run, _in_disparity_map),
    }


def _linear(view: StereoView, left_px: Array, right_px: Array) -> Array | None:
    """OpenCV's direct linear transformation (3,)."""
    normalised = []
    for camera, px in ((view.left.camera, left_px), (view.right.camera, right_px)):
        point = cv2.undistortPoints(np.asarray(px).reshape(1, 1, 2), camera.K, np.array(camera.distortion))
        normalised.append(np.asarray(point, dtype=float).reshape(2, 1))
    projections = view.left.T_camera_root[:3], view.right.T_camera_root[:3]
    homogeneous = cv2.triangulatePoints(*projections, *normalised)[:, 0]
    return np.asarray(homogeneous[:3] / homogeneous[3])


def _in_disparity_map(pair: Pair) -> Array | None:
    """Centre (3,) of the ball from the median disparity of its middle, by block matching of the whole images.

    The ball's direction, taken from its true position, replaces an image tracker's.
    """
    left, right, R_root_rect, Q = _rectified(pair.view, pair.frame)
    grey = [
        cv2.copyMakeBorder(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), 0, 0, _RANGE_PX, 0, cv2.BORDER_REPLICATE)
        for image in (left, right)
    ]
    disparity = np.asarray(cv2.StereoBM.create(_RANGE_PX, 15).compute(*grey), dtype=float)[:, _RANGE_PX:] / 16
    focal = Q[2, 3]
    baseline = float(np.linalg.norm(pair.view.right.center - pair.view.left.center))
    line = pair.p - pair.view.left.center
    toward = R_root_rect.T @ line
    distance = float(np.linalg.norm(toward))
    u, v = focal * toward[:2] / toward[2] - Q[:2, 3]
    rows, columns = np.mgrid[: disparity.shape[0], : disparity.shape[1]]
    disc = (columns - u) ** 2 + (rows - v) ** 2 <= (0.5 * BALL_M / distance * focal) ** 2
    valid = disparity[disc & (disparity > 0)]
    if len(valid) < max(0.3 * np.count_nonzero(disc), 5):
        return None
    depth = focal * baseline / float(np.median(valid))
    return np.asarray(pair.view.left.center + line * depth / toward[2] / (1 - _NEARER * BALL_M / distance))


def _rectified(view: StereoView, frame: StereoFrame) -> tuple[Image, Image, Array, Array]:
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


def _ours(pair: Pair) -> Array | None:
    point = triangulate(pair.view, pair.left.center_px, pair.right.center_px, pair.left.cov_px, pair.right.cov_px)
    return None if point is None else point.p_root


def _run(method: Callable[[Pair], Array | None], recording: list[Pair], seed: int) -> Values:
    points, ms = timed_steps(method, recording)
    pairs = zip(points, recording, strict=True)
    error_mm = [1000 * float(np.linalg.norm(p - pair.p)) for p, pair in pairs if p is not None]
    return {"error_mm": error_mm, "ms": ms}
