"""Stereo association: which outlines in the two images show one object, and where it is (R Fig 13)."""

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoView, View
from pps_vision.geometry.se3 import move_points
from pps_vision.geometry.triangulation import Triangulation, triangulate
from pps_vision.jit import njit
from pps_vision.types import Array, Image, Observation3D, StereoFrame
from tracking.outline import Outline

Found = list[Outline] | None
"""Outlines of the object in an image, at most one; None if the image has not been searched, or not with certainty."""

_MIN_ERROR_PX = 0.005  # least standard deviation of the calibration's error: the covariance stays regular
_MEMORY = 20.0  # number of pairs over which the residuals are averaged
_MAX_RADIUS_RATIO = 1.7  # of the two angular radii
# Chosen on independent films (seeds 4100, 4101), judged on others (4200, 4201: 95 % ellipsoid 84 → 94 %).
_OUTLINE_RATE = 0.2  # at which the outlines' variance follows a pair; 0.1 and 0.35 do as well
# Of an edge's first harmonic, which shifts the centre, to its second and third where both eyes see them alike: ratio of
# the variances.  Chosen on independent films (seeds 7000, 7001) and rendered recordings (300), judged on others (7002,
# 7003, 301).
_TO_FIRST = 2.5
_BLURRED = 8.0  # px²: non-circularity times squared radius of a ball's image that is blurred by σ = √2 px
_SQUARE = math.pi / 3 - 1  # non-circularity of a square
_OBLIQUE = 0.5  # tangent of the angle at which a flat object may be seen


Refusal = Literal["size", "point behind the cameras", "epipolar gate", "distance"]
"""Why two outlines do not show one object: the ratio of their radii, where their lines of sight meet, by how much these
miss each other, or the distance in baselines."""


class CameraFrame(NamedTuple):
    """One camera's image, its pose and stamp, the robot's joints then (None: no robot), and what was found in the image
    beforehand."""

    image: Image
    view: View
    stamp_s: float
    joints_rad: Array | None
    found: Found = None


CameraFrames = tuple[CameraFrame, CameraFrame]  # left, right


def camera_frames(frame: StereoFrame, view: StereoView, found: tuple[Found, Found] = (None, None)) -> CameraFrames:
    """The left and right half of a stereo frame whose cameras are at `view`."""
    return (
        CameraFrame(frame.left, view.left, frame.stamp_left_s, frame.joints_left_rad, found[0]),
        CameraFrame(frame.right, view.right, frame.stamp_right_s, frame.joints_right_rad, found[1]),
    )


@dataclass(frozen=True)
class StereoParams:
    """Gates of the association, and how the calibration's error is learnt from the residuals."""

    unknown_error: float = 0.008
    """Standard deviation of the calibration's error before any pair was seen, as a share of the image's width."""
    gate_sigma: float = 3.5
    """Width of the epipolar gate in standard deviations of the expected residual."""
    distance_range: tuple[float, float] = (0.7, 300.0)
    """Least and largest distance, in baselines."""

    def __post_init__(self) -> None:
        if not (
            self.unknown_error > 0 and self.gate_sigma > 0 and 0 <= self.distance_range[0] < self.distance_range[1]
        ):
            raise InputError(
                "stereo association",
                f"error of the calibration {self.unknown_error}, gate {self.gate_sigma}, distances "
                f"{self.distance_range}; expected positive numbers and a rising range",
            )


@dataclass(frozen=True)
class Association:
    """Triangulates pairs of outlines.  Immutable; `learned` gives the association after one more pair.

    Four image coordinates and three unknowns leave one degree of freedom: 4·residual² estimates the variance of each
    coordinate.  What is more than the outlines' is the calibration's.  The outlines' is at least what the two of one
    object differ by (`_disagreement`); what their asymmetries share (`_shared_asymmetry`) is an error of both eyes.
    What the last few pairs differ by less than all did is no gain: outlines that hardly change tell little.  That much
    of the outlines' variance lasts from frame to frame.
    """

    params: StereoParams
    gate_var_px2: float
    calibration_var_px2: float
    outline_var_px2: float = 0.0
    """Beyond the outlines' covariances, of the last pairs."""
    mean_outline_var_px2: float = 0.0
    """The same of all pairs."""
    shared_var_px2: float = 0.0
    pairs: int = 0

    @classmethod
    def untrained(cls, params: StereoParams, width: int) -> "Association":
        """Before any pair was seen, for images of that width (px)."""
        unknown = (params.unknown_error * width) ** 2
        return cls(params, unknown, unknown)

    @property
    def error_px(self) -> float:
        """Standard deviation that calibration and outlines add to each image coordinate's own."""
        return max(math.sqrt(max(self.calibration_var_px2, 0.0) + max(self.outline_var_px2, 0.0)), _MIN_ERROR_PX)

    def observe(
        self,
        view: StereoView,
        left: Outline,
        right: Outline,
        stamp_s: float,
        shift_px: tuple[Array, Array] | None = None,
    ) -> Observation3D | None:
        """The object that both outlines show; None where they cannot show one object.

        `shift_px` moves each centre from its own stamp to the pair's, for cameras that are not synchronised.
        """
        left_px, right_px = left.center_px, right.center_px
        if shift_px is not None:
            left_px, right_px = left_px + shift_px[0], right_px + shift_px[1]
        found = self._triangulated(view, left, right, left_px, right_px)
        if isinstance(found, str):
            return None
        radius, radius_var = _radius(
            *(found.p_root, found.cov_root),
            (*view.left.place, left.angular_radius_rad, left.angular_radius_var),
            (*view.right.place, right.angular_radius_rad, right.angular_radius_var),
        )
        beyond_px2 = max(self.mean_outline_var_px2, 0.0) - max(self.outline_var_px2, 0.0)
        lasting = max(beyond_px2, 0.0) / (_mean_var(left, right) + self.error_px**2) * found.cov_root
        shared = lasting + self._shared_cov(view, found.p_root, left, right, radius)
        cov = found.cov_root + shared
        return Observation3D(stamp_s, found.p_root, cov, radius, radius_var, found.residual_px, shared)

    def _shared_cov(self, view: StereoView, p_root: Array, left: Outline, right: Outline, radius_m: float) -> Array:
        """(3, 3) m²: what both eyes' outlines are off by together, across the line of sight; and of what is no ball,
        its unknown shape.

        The mean direction of a ball's solid angle is its centre's.  Those of a disc of radius R at the distance Z that
        faces two eyes meet R²/Z behind its centre; if it is oblique by β, they pass R²/Z·tan β beside it.
        All between ball and disc is equally likely, which makes it a third of the square, and tan β is ½.
        """
        ahead = p_root - view.midpoint
        focal2, far2 = view.left.camera.focal_px**2, float(ahead @ ahead)
        angle2 = max(self.shared_var_px2, 0.0) / focal2
        blurred = _BLURRED / (left.angular_radius_rad * right.angular_radius_rad * focal2)
        excess = 0.5 * (left.non_circularity + right.non_circularity) - blurred
        flat2 = min(max(excess / _SQUARE, 0.0), 1.0) * radius_m**4 / far2 / 3
        across = angle2 + _OBLIQUE**2 * flat2 / far2
        cov: Array = across * far2 * np.eye(3) + (flat2 / far2 - across) * np.outer(ahead, ahead)
        return cov

    def refusal(self, view: StereoView, left: Outline, right: Outline) -> Refusal | None:
        """Why `observe` returns None for two outlines; None where it does not."""
        found = self._triangulated(view, left, right, left.center_px, right.center_px)
        return found if isinstance(found, str) else None

    def _triangulated(
        self, view: StereoView, left: Outline, right: Outline, left_px: Array, right_px: Array
    ) -> Triangulation | Refusal:
        """The point at which two outlines with these centres show one object, or why they show none."""
        p = self.params
        ratio = left.angular_radius_rad / right.angular_radius_rad
        if max(ratio, 1 / ratio) > _MAX_RADIUS_RATIO:
            return "size"
        found = triangulate(view, left_px, right_px, left.cov_px, right.cov_px, self.error_px**2)
        if found is None:
            return "point behind the cameras"
        if 4 * found.residual_px**2 > p.gate_sigma**2 * (_mean_var(left, right) + self.gate_var_px2):
            return "epipolar gate"
        baseline = math.dist(view.right.place, view.left.place)
        if (
            not p.distance_range[0] * baseline
            <= math.dist(found.p_root, view.left.place)
            <= p.distance_range[1] * baseline
        ):
            return "distance"
        return found

    def learned(self, view: StereoView, observation: Observation3D, left: Outline, right: Outline) -> "Association":
        """The association after an accepted pair; unchanged where a part of the object is hidden, since its centre is
        then off by more than the calibration.

        The first few pairs estimate the calibration's variance badly: 1 + 3/n times the mean is stated.  Differences
        that are smaller than the outlines' covariances count too, or these would be counted twice.
        """
        if left.is_partial or right.is_partial:
            return self
        own, residual2 = _mean_var(left, right), 4 * observation.residual_px**2
        pairs, before = min(self.pairs + 1, _MEMORY), min(self.pairs, _MEMORY)
        rate = max(1 / pairs, _OUTLINE_RATE)
        difference = _disagreement(view, observation.p_root, left, right) - own
        outline = self.outline_var_px2 + rate * (difference - self.outline_var_px2)
        shared = _TO_FIRST * _shared_asymmetry(view, left, right)
        excess = residual2 - own - max(outline, 0.0)
        mean = self.calibration_var_px2 / (1 + 3 / before) if before else 0.0
        return replace(
            self,
            gate_var_px2=self.gate_var_px2 + (max(residual2 - own, 0.0) - self.gate_var_px2) / _MEMORY,
            calibration_var_px2=(mean + (excess - mean) / pairs) * (1 + 3 / pairs),
            outline_var_px2=outline,
            mean_outline_var_px2=self.mean_outline_var_px2
            + (difference - self.mean_outline_var_px2) / (self.pairs + 1),
            shared_var_px2=self.shared_var_px2 + rate * (shared - self.shared_var_px2),
            pairs=self.pairs + 1,
        )


def _disagreement(view: StereoView, p_root: Array, left: Outline, right: Outline) -> float:
    """Mean square (px²) of five differences between both outlines of a ball at `p_root` (3,): radius at the same
    distance, second and third harmonic.

    Errors that are independent along an edge give all its harmonics the variance of the centre's coordinates, and the
    radius half of it.
    """
    focal = view.left.camera.focal_px
    far = math.dist(p_root, view.left.place), math.dist(p_root, view.right.place)
    a, b = left.angular_radius_rad * focal, right.angular_radius_rad * focal
    radius = 2 * (a * far[0] - b * far[1]) / (far[0] + far[1])
    edge = sum((a * one - b * other) ** 2 for one, other in zip(left.harmonics, right.harmonics, strict=True))
    return 0.2 * (radius**2 + 0.5 * edge)


def _shared_asymmetry(view: StereoView, left: Outline, right: Outline) -> float:
    """Covariance (px²) of the second and third harmonics of both outlines, as `_disagreement` has its variance.

    What is longer than wide counts too: it may be the object and the place that it left.
    """
    shared = sum(one * other for one, other in zip(left.harmonics, right.harmonics, strict=True))
    return 0.25 * shared * left.angular_radius_rad * right.angular_radius_rad * view.left.camera.focal_px**2


Seen = tuple[float, float, float, float, float]
"""An eye's place (x, y, z), the angular radius (rad) that it sees and its variance."""


@njit(cache=True, error_model="numpy")
def _radius(p: Array, cov: Array, left: Seen, right: Seen) -> tuple[float, float]:
    """Radius (m) of a ball at p (3,) with cov (3, 3), the mean of both eyes' by their weights, and its variance: that
    of the better eye alone, since the distance's error is common to both."""
    total = most = sum_of_weights = 0.0
    for eye in (left, right):
        u, v, w, angle, angle_var = eye
        x, y, z = p[0] - u, p[1] - v, p[2] - w
        far2, sine = x * x + y * y + z * z, math.sin(angle)
        along = x * x * cov[0, 0] + y * y * cov[1, 1] + z * z * cov[2, 2]
        along += 2 * (x * y * cov[0, 1] + x * z * cov[0, 2] + y * z * cov[1, 2])
        weight = 1 / (far2 * (1 - sine**2) * angle_var + sine**2 * along / far2)
        total, most, sum_of_weights = (
            total + weight * math.sqrt(far2) * sine,
            max(most, weight),
            sum_of_weights + weight,
        )
    return total / sum_of_weights, 1 / most


def _mean_var(left: Outline, right: Outline) -> float:
    """Mean variance of the four coordinates, px²."""
    ((a, _), (_, b)), ((c, _), (_, d)) = left.cov_px.tolist(), right.cov_px.tolist()
    return 0.25 * float(a + b + c + d)


def with_pose_error(
    observation: Observation3D, before: StereoView, now: StereoView, dt_s: float, stamp_error_s: float
) -> Observation3D:
    """The observation with the covariance that joints of another moment add.

    Joints that are `stamp_error_s` (a standard deviation) off the images put a resting object off by the apparent
    velocity of what rests in both images while the head turns.
    """
    off_m = stamp_error_s * apparent_velocity(before, now, observation.p_root, dt_s)
    cov, correlated = observation.cov_root, observation.correlated_cov_root
    pose = np.outer(off_m, off_m)
    return replace(observation, cov_root=cov + pose, correlated_cov_root=correlated + pose)


def apparent_velocity(before: StereoView, now: StereoView, p_root: Array, dt_s: float) -> Array:
    """(3,) m/s: the velocity that a point at rest in both images, now seen at `p_root` (3,), has in the root frame
    as the head turns and the eyes converge from one view to the next."""
    slopes, drifts = [], []
    for then, eye in ((before.left, now.left), (before.right, now.right)):
        was = move_points(then.T_root_camera, move_points(eye.T_camera_root, p_root))
        slopes.append(eye.project_jacobian(p_root))
        drifts.append(slopes[-1] @ (p_root - was) / dt_s)
    J, drift = np.concatenate(slopes), np.concatenate(drifts)
    velocity: Array = np.linalg.solve(J.T @ J, J.T @ drift)
    return velocity
