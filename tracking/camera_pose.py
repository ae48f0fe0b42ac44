"""Camera poses estimated from the images: a rig that is declared fixed, or a head whose joints lag."""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from pps_vision.geometry.camera import StereoRig, StereoView, View
from pps_vision.geometry.se3 import transform
from pps_vision.types import Array, Image, StereoFrame
from tracking.ego_motion import ROOM_M
from tracking.image_rotation import Misalignment, Reference

_ROOM_STD = 0.5  # 1/m: standard deviation of the background's inverse distance
_REST_PX = 0.1  # a smaller rotation is none
_SAME_PX = 0.5  # largest difference of both cameras' rotations
_JITTER_MEMORY_S = 1.0  # averaging time of the rotation rate and of the jitter of joints
_RENEWED_S = 0.5  # a reference that does not match for this long is replaced
_APART_S = 0.12  # time between the two images of a measurement of the delay
_GAP_S = 0.25  # longest time between frames for a joint velocity
_DELAY_MEMORY_S = 10.0  # averaging time of the delay
_NOISE_PX = 0.05  # noise of a rotation between two images, per axis
_SCATTER_PRIOR = 6.0  # number of measured angles that the assumed noise is worth
_SURE_PX = 0.03  # a delay whose error shifts the image by less is measured every `_SELDOM_S`
_SELDOM_S = 1.0

Joints = tuple[Array, Array]  # (n,) rad, at the left and the right image


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
    root frame) and its rate (rad/s, mean of the last second); lag of the joints and its standard deviation (s)."""

    rotation_rad: Array
    rate_rad_s: float
    delay_s: float
    delay_std_s: float


class PoseEstimator:
    """Estimates the poses of the cameras; `step` takes frames in the order of their stamps.

    Args:
        rig: The cameras, and their nominal poses.
        stamp_error_s: Standard deviation of the time by which joints are late, before any image; 0: never.
    """

    def __init__(self, rig: StereoRig, stamp_error_s: float) -> None:
        self._rig = rig
        self._fixed = _FixedRig()
        self._late = _LateJoints(rig, stamp_error_s) if stamp_error_s > 0 else None

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
        return CameraMotion(self._fixed.rotation.copy(), self._fixed.rate_rad_s, *delay)


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
        self._references: list[tuple[Reference, Reference]] = []

    def step(self, frame: StereoFrame, nominal: StereoView) -> CameraPoses:
        images = (frame.left, frame.right)
        stamp_s = frame.stamp_s
        if not self._references:
            self._renew(images, nominal, stamp_s)
        rotation = self._measured(images, nominal)
        if rotation is None:
            if stamp_s - self._known_s > _RENEWED_S:
                self._renew(images, nominal, stamp_s)
            return CameraPoses(_turned(nominal, self.rotation), is_known=False)
        dt_s = stamp_s - self._known_s
        if dt_s > 0:
            share = min(dt_s / _JITTER_MEMORY_S, 1.0)
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
            Reference(eye.camera, image.copy(), eye.T_root_camera)
            for eye, image in zip((view.left, view.right), images, strict=True)
        )
        self._references[1:] = [(left, right)]
        self._known_s = stamp_s

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
                return rotation if math.hypot(*rotation) > _REST_PX / focal_px else np.zeros(3)
        return None


def _turned(nominal: StereoView, rotation: Array) -> StereoView:
    """The view turned by a rotation vector (3,) about the midpoint of the cameras."""
    if not rotation.any():
        return nominal
    R = np.asarray(cv2.Rodrigues(rotation)[0], float)
    T = transform(R, nominal.midpoint - R @ nominal.midpoint)
    left, right = (View(view.camera, T @ view.T_root_camera) for view in (nominal.left, nominal.right))
    return StereoView(left, right)


class _LateJoints:
    """Lag of the joints behind the images; a frame's joints are extrapolated by it.

    A lag τ causes a rotation error τ·ω.  The background in two images of a camera shows the change of that error; its
    inverse distance is estimated too (recursive least squares).  The scatter of the measurements scales the variance.
    A priori the joints are exact or late, each with probability ½; the delay and its variance are the mean and the
    variance of this mixture.
    """

    def __init__(self, rig: StereoRig, prior_std_s: float) -> None:
        self._rig = rig
        self._prior = np.diag([prior_std_s**-2, _ROOM_STD**-2])
        self._prior_std_s = prior_std_s
        self._information = np.zeros((2, 2))
        self._pull = np.zeros(2)
        self._misfit_rad2 = 0.0
        self._scatter = 0.0  # sum of the squared normalised misfits
        self._scattered = 0.0  # their number
        self._past: deque[tuple[float, StereoView, Joints]] = deque(maxlen=3)
        self._reference: tuple[Reference, Array, float] | None = None  # with the angular velocity and the stamp
        self._eye = 0
        self._measured_s = -math.inf
        self.delay_s = 0.0
        self.std_s = prior_std_s

    def step(self, frame: StereoFrame, nominal: StereoView, joints: Joints) -> CameraPoses:
        if self._past and frame.stamp_s - self._past[-1][0] > _GAP_S:
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
            if stamp_s - then_s < _APART_S - 1e-6:
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
        if is_sure and stamp_s - self._measured_s < _SELDOM_S:
            return
        self._reference = (Reference(view.camera, image.copy(), view.T_root_camera), rate, stamp_s)

    def _update(self, measured: Misalignment, change: Array, stamp_s: float) -> None:
        """Update the delay by a rotation: the delay times a `change` (3,) of angular velocity, plus parallax."""
        X = np.column_stack([change, measured.by_parallax])
        noise = measured.cov + (_NOISE_PX / self._rig.left.focal_px) ** 2 * np.eye(3)
        W = np.linalg.inv(noise)
        elapsed_s = min(stamp_s - self._measured_s, _DELAY_MEMORY_S)
        keep = math.exp(-elapsed_s / _DELAY_MEMORY_S)
        self._information = keep * self._information + X.T @ W @ X
        self._pull = keep * self._pull + X.T @ W @ measured.rotation
        cov = np.linalg.inv(self._prior + self._information)
        estimate = cov @ self._pull
        misfit = measured.rotation - X @ estimate
        self._scatter = keep * self._scatter + float(misfit @ W @ misfit)
        self._scattered = keep * self._scattered + 3
        beyond = (float(misfit @ misfit) - float(np.trace(noise))) / 3
        self._misfit_rad2 += (beyond - self._misfit_rad2) * min(elapsed_s / _JITTER_MEMORY_S, 1.0)
        scale = (_SCATTER_PRIOR + self._scatter) / (_SCATTER_PRIOR + self._scattered)
        self.delay_s, self.std_s = exact_or_late(float(estimate[0]), scale * cov[0, 0], self._prior_std_s)
        self._measured_s = stamp_s


def exact_or_late(late_s: float, late_var_s2: float, prior_std_s: float) -> tuple[float, float]:
    """Mean and standard deviation (s) of a delay that is 0 with probability ½, else normal about 0 with `prior_std_s`.

    `late_s` and `late_var_s2` are its mean and variance if it is not 0.  The odds of 0 are the ratio of posterior and
    prior density there (Dickey 1971).
    """
    odds = prior_std_s / math.sqrt(late_var_s2) * math.exp(-0.5 * late_s**2 / late_var_s2)
    is_late = 1 / (1 + odds)
    delay_s = is_late * late_s
    return delay_s, math.sqrt(is_late * (late_var_s2 + late_s**2) - delay_s**2)
