"""Stereo association: pair outlines of both images and triangulate them, with covariance (R Fig 13)."""

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from pps_vision.errors import InputError
from pps_vision.geometry.camera import StereoView, View, sight
from pps_vision.geometry.triangulation import Triangulation, triangulate
from pps_vision.jit import njit
from pps_vision.types import Array, Image, Observation3D, StereoFrame
from tracking.outline import SHARP_PX, VISIBLE_EDGE_PX, Outline

Outlines = list[Outline] | None
"""Outlines of the object in an image (`batch`); None if the image has not been searched."""

_MIN_ERROR_PX = 0.005  # smallest standard deviation of the calibration's error: the covariance stays regular
_MEMORY_PAIRS = 20.0  # number of pairs over which the residuals are averaged
_MAX_RADIUS_RATIO = 1.7  # ratio between the radii (m) that both outlines give an object
# Chosen on independent films (seeds 4100, 4101), judged on others (4200, 4201: 95 % ellipsoid 84 → 94 %).
_OUTLINE_RATE = 0.2  # at which the outlines' variance follows a pair; 0.1 and 0.35 do as well
# Ratio of the variances of an edge's first harmonic, which shifts the centre, to its second and third where both eyes
# see the same edge.  Chosen on independent films (seeds 7000, 7001) and rendered recordings (300), judged on others
# (7002, 7003, 301).
_TO_FIRST = 2.5
# Error of the centre by the object's shading, which both eyes share, at a sharp edge; it grows with the cube of blur.
# Chosen on independent films (seeds 8202, 8203, 33100).
_SHADED_PX = 0.02
# Non-circularity times squared radius (px²) of a ball whose edge errs, as before a background of its colour.
_ROUGH = 4.0
_SQUARE = math.pi / 3 - 1  # non-circularity of a square
# Standard deviation of the depth of a non-ball's contour from its centre, as a share of the radius, and of its distance
# across the line of sight, as a share of that.  Chosen on 63 starts in simulation (seed 6001), judged on 200 others.
_CONTOUR = 0.18
_OBLIQUE = 0.3
_STEADY = 0.8  # share of the variance by stale joints that stays from image to image, as the velocity of the head does

Refusal = Literal["size", "point behind the cameras", "epipolar gate", "distance"]
"""Reason why two outlines do not show one object: ratio of the radii at its distances, intersection of their lines of
sight, epipolar residual, or distance in baselines."""


class CameraFrame(NamedTuple):
    """One camera's image, pose and stamp, the robot's joints at the stamp (None: no robot), and precomputed
    outlines (`batch`)."""

    image: Image
    view: View
    stamp_s: float
    joints_rad: Array | None
    outlines: Outlines = None


CameraFrames = tuple[CameraFrame, CameraFrame]  # left, right


def camera_frames(
    frame: StereoFrame, view: StereoView, outlines: tuple[Outlines, Outlines] = (None, None)
) -> CameraFrames:
    """Return the left and right half of a stereo frame whose cameras are at `view`."""
    return (
        CameraFrame(frame.left, view.left, frame.stamp_left_s, frame.joints_left_rad, outlines[0]),
        CameraFrame(frame.right, view.right, frame.stamp_right_s, frame.joints_right_rad, outlines[1]),
    )


@dataclass(frozen=True)
class StereoParams:
    """Gates of the association, and the prior of the calibration's error."""

    unknown_error: float = 0.008
    """Prior standard deviation of the calibration's error, as a share of the image's width."""
    gate_sigma: float = 3.5
    """Width of the epipolar gate in standard deviations of the expected residual."""
    farthest: float = 300.0
    """Largest distance, in baselines."""

    def __post_init__(self) -> None:
        if not (self.unknown_error > 0 and self.gate_sigma > 0 and self.farthest > 0):
            raise InputError(
                "stereo association",
                f"error of the calibration {self.unknown_error}, gate {self.gate_sigma}, largest distance "
                f"{self.farthest}; expected positive numbers",
            )


@dataclass(frozen=True)
class Association:
    """Triangulates pairs of outlines and estimates their errors.  Immutable; `learned` gives the next association.

    Four image coordinates and three unknowns leave one degree of freedom: 4·residual² estimates the variance of each
    coordinate.  The part that the outlines do not explain is the calibration's.  The outlines' variance is at least
    that of the differences between both outlines (`_differences`); their common asymmetry (`_shared_asymmetry`) is an
    error of both eyes.  Where the last pairs differ less than all pairs did, outlines hardly change and tell little:
    the difference in variance is added.

    Only what changes in the differences from pair to pair is white, and the hidden part of a partial outline.  All else
    is a correlated error: that of the calibration, of the edge, and of a body that both eyes see from different sides.
    """

    params: StereoParams
    gate_var_px2: float
    calibration_var_px2: float
    outline_var_px2: float = 0.0  # variance of the last pairs, in excess of the outlines' covariances
    mean_outline_var_px2: float = 0.0  # of all pairs
    shared_var_px2: float = 0.0
    differences_px: Array | None = None  # (5,) of the last pair
    change_var_px2: float = 0.0  # half the mean square of their change from pair to pair
    pairs: int = 0

    @classmethod
    def untrained(cls, params: StereoParams, width: int) -> "Association":
        """Return the association before the first pair, for images of that width (px)."""
        prior_var_px2 = (params.unknown_error * width) ** 2
        return cls(params, prior_var_px2, prior_var_px2)

    @property
    def is_whole_seen(self) -> bool:
        """Whether both eyes have seen the whole object."""
        return self.differences_px is not None

    def _is_held(self, left: Outline, right: Outline) -> bool:
        """Whether visible edges were fitted to an object that was never whole, as in a hand from the start."""
        return not self.is_whole_seen and all(eye.is_edge and not eye.is_cut for eye in (left, right))

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
        """Return the object that both outlines show; None if they cannot show one object.

        `shift_px` moves each centre from its own stamp to the pair's, for cameras that are not synchronised.
        """
        point = self.triangulated(view, left, right, shift_px)
        if isinstance(point, str):
            return None
        radius, radius_var = _radius(
            point.p_root,
            point.cov_root,
            (*view.left.place, left.angular_radius_rad, left.angular_radius_var),
            (*view.right.place, right.angular_radius_rad, right.angular_radius_var),
        )
        total_px2 = _mean_var(left, right) + self.error_px**2
        excess_px2 = max(self.mean_outline_var_px2, 0.0) - max(self.outline_var_px2, 0.0)
        hidden_px2 = 0.5 * (left.hidden_px**2 + right.hidden_px**2)
        added = (max(excess_px2, 0.0) + hidden_px2) / total_px2 * point.cov_root
        cov = point.cov_root + added + self._shared_cov(view, point.p_root, left, right, radius)
        white_px2 = self._white_var(view, point.p_root, left, right)
        correlated = cov - min(white_px2 / total_px2, 1.0) * point.cov_root
        return Observation3D(stamp_s, point.p_root, cov, radius, radius_var, point.residual_px, correlated)

    def _white_var(self, view: StereoView, p_root: Array, left: Outline, right: Outline) -> float:
        """Variance (px²) of each image coordinate's white error, for outlines of an object at `p_root` (3,)."""
        if left.is_partial or right.is_partial:
            systematic = VISIBLE_EDGE_PX**2 * self._is_held(left, right)
            return max(self.change_var_px2, _mean_var(left, right) - systematic)
        if not self.is_whole_seen:
            return 0.5 * float(np.mean(_differences(view, p_root, left, right) ** 2)) + _MIN_ERROR_PX**2
        return self.change_var_px2 + _MIN_ERROR_PX**2

    def _shared_cov(self, view: StereoView, p_root: Array, left: Outline, right: Outline, radius_m: float) -> Array:
        """(3, 3) m²: common error of both outlines across the line of sight, and the unknown shape of a non-ball.

        The mean direction of a ball's solid angle is its centre's.  Of any other shape both eyes' directions meet about
        where its contour is, which is in front of the centre or behind it: half a side in front of it for a cube that
        shows one face.  They pass beside the centre as far as the shape is turned away.
        """
        line = sight(view.centers, p_root)
        distance2 = float(line @ line)
        focal2 = view.left.camera.focal_px**2
        rough = _ROUGH / (left.angular_radius_rad * right.angular_radius_rad * focal2)
        flatness = (0.5 * (left.non_circularity + right.non_circularity) - rough) / _SQUARE
        flat_var = min(max(flatness, 0.0), 1.0) * (_CONTOUR * radius_m) ** 2
        blur = max(left.blur_px, right.blur_px, SHARP_PX) / SHARP_PX
        shared_px2 = (_SHADED_PX * blur**3) ** 2 + max(self.shared_var_px2, 0.0)
        angle_var = shared_px2 / focal2 + _OBLIQUE**2 * flat_var / distance2
        cov: Array = angle_var * distance2 * np.eye(3) + (flat_var / distance2 - angle_var) * np.outer(line, line)
        return cov

    def refusal(
        self, view: StereoView, left: Outline, right: Outline, max_ratio: float = _MAX_RADIUS_RATIO
    ) -> Refusal | None:
        """Return the reason why `observe` returns None for two outlines, or "size" if their radii at the object differ
        by more than `max_ratio`; else None."""
        result = self.triangulated(view, left, right, max_ratio=max_ratio)
        return result if isinstance(result, str) else None

    def triangulated(
        self,
        view: StereoView,
        left: Outline,
        right: Outline,
        shift_px: tuple[Array, Array] | None = None,
        max_ratio: float = _MAX_RADIUS_RATIO,
    ) -> Triangulation | Refusal:
        """Return the point that two outlines show, as `observe`, or the reason why they do not show one object."""
        left_px, right_px = left.center_px, right.center_px
        if shift_px is not None:
            left_px, right_px = left_px + shift_px[0], right_px + shift_px[1]
        point = triangulate(view, left_px, right_px, left.cov_px, right.cov_px, self.error_px**2)
        if point is None:
            return "point behind the cameras"
        left_m = math.dist(point.p_root, view.left.place)
        ratio = left_m * left.angular_radius_rad / math.dist(point.p_root, view.right.place) / right.angular_radius_rad
        if max(ratio, 1 / ratio) > max_ratio:
            return "size"
        gate_px2 = self.params.gate_sigma**2 * (_mean_var(left, right) + self.gate_var_px2)
        if 4 * point.residual_px**2 > gate_px2:
            return "epipolar gate"
        if left_m > self.params.farthest * math.dist(view.right.place, view.left.place):
            return "distance"
        return point

    def learned(
        self, view: StereoView, point: Triangulation | Observation3D, left: Outline, right: Outline
    ) -> "Association":
        """Return the association after an accepted pair, which shows a point; unchanged if a part of the object is
        hidden or may be, since its centre is then off by more than the calibration.  In a hand from the start, the
        fitted visible edge tells the calibration's error.

        Differences that are smaller than the outlines' covariances count too, or these would be counted twice.
        """
        own_var = _mean_var(left, right)
        unexplained = 4 * point.residual_px**2 - own_var
        if self._is_held(left, right):
            return self._with_residual(unexplained, 0.0)
        if left.is_partial or right.is_partial or left.hidden_px + right.hidden_px > 0:
            return self
        rate = max(1 / min(self.pairs + 1, _MEMORY_PAIRS), _OUTLINE_RATE)
        differences_px = _differences(view, point.p_root, left, right)
        difference = float(np.mean(differences_px**2)) - own_var
        change_px = differences_px - (0.0 if self.differences_px is None else self.differences_px)
        change_var = 0.5 * float(np.mean(change_px**2))
        change_rate = max(1 / max(self.pairs, 1), _OUTLINE_RATE) if self.is_whole_seen else 1.0
        outline_var = self.outline_var_px2 + rate * (difference - self.outline_var_px2)
        shared_var = _TO_FIRST * _shared_asymmetry(view, left, right)
        return replace(
            self._with_residual(unexplained, max(outline_var, 0.0)),
            outline_var_px2=outline_var,
            mean_outline_var_px2=self.mean_outline_var_px2
            + (difference - self.mean_outline_var_px2) / (self.pairs + 1),
            shared_var_px2=self.shared_var_px2 + rate * (shared_var - self.shared_var_px2),
            differences_px=differences_px,
            change_var_px2=self.change_var_px2 + change_rate * (change_var - self.change_var_px2),
        )

    def _with_residual(self, unexplained_px2: float, of_outlines_px2: float) -> "Association":
        """The association after a pair whose squared residual its covariances leave unexplained by this, and a part of
        it is the outlines'.

        The first few pairs estimate the calibration's variance badly: 1 + 3/n times the mean is stated.
        """
        n_before = min(self.pairs, _MEMORY_PAIRS)
        n = min(self.pairs + 1, _MEMORY_PAIRS)
        mean = self.calibration_var_px2 / (1 + 3 / n_before) if n_before else 0.0
        excess = unexplained_px2 - of_outlines_px2
        return replace(
            self,
            gate_var_px2=self.gate_var_px2 + (max(unexplained_px2, 0.0) - self.gate_var_px2) / _MEMORY_PAIRS,
            calibration_var_px2=(mean + (excess - mean) / n) * (1 + 3 / n),
            pairs=self.pairs + 1,
        )


def _differences(view: StereoView, p_root: Array, left: Outline, right: Outline) -> Array:
    """(5,) px: differences between both outlines of a ball at `p_root` (3,): radius at the same distance, second and
    third harmonic, these over √2.

    Errors that are independent along an edge give all its harmonics the variance of the centre's coordinates, and the
    radius half of it: the variance of every difference.
    """
    focal_px = view.left.camera.focal_px
    left_m = math.dist(p_root, view.left.place)
    right_m = math.dist(p_root, view.right.place)
    left_px = left.angular_radius_rad * focal_px
    right_px = right.angular_radius_rad * focal_px
    radius = 2 * (left_px * left_m - right_px * right_m) / (left_m + right_m)
    pairs = zip(left.harmonics, right.harmonics, strict=True)
    return np.array([radius, *(math.sqrt(0.5) * (left_px * a - right_px * b) for a, b in pairs)])


def _shared_asymmetry(view: StereoView, left: Outline, right: Outline) -> float:
    """Covariance (px²) of the second and third harmonics of both outlines, as `_differences` has their variance.

    An elongated shape counts too: it may be the object together with the place that it left.
    """
    shared = sum(a * b for a, b in zip(left.harmonics, right.harmonics, strict=True))
    return 0.25 * shared * left.angular_radius_rad * right.angular_radius_rad * view.left.camera.focal_px**2


EyeRadius = tuple[float, float, float, float, float]
"""An eye's position (x, y, z), and the object's angular radius (rad) in its image with variance."""


@njit(cache=True, error_model="numpy")
def _radius(p: Array, cov: Array, left: EyeRadius, right: EyeRadius) -> tuple[float, float]:
    """Radius (m) of a ball at p (3,) with cov (3, 3): weighted mean of r = |p − c| sin θ over both eyes.  Its variance
    is that of the better eye alone, since the distance's error is common to both."""
    weighted_sum = 0.0
    sum_of_weights = 0.0
    max_weight = 0.0
    for u, v, w, angle, angle_var in (left, right):
        x = p[0] - u
        y = p[1] - v
        z = p[2] - w
        distance2 = x * x + y * y + z * z
        sine = math.sin(angle)
        along = x * x * cov[0, 0] + y * y * cov[1, 1] + z * z * cov[2, 2]
        along += 2 * (x * y * cov[0, 1] + x * z * cov[0, 2] + y * z * cov[1, 2])
        weight = 1 / (distance2 * (1 - sine**2) * angle_var + sine**2 * along / distance2)
        weighted_sum += weight * math.sqrt(distance2) * sine
        sum_of_weights += weight
        max_weight = max(max_weight, weight)
    return weighted_sum / sum_of_weights, 1 / max_weight


def _mean_var(left: Outline, right: Outline) -> float:
    """Mean variance of the four coordinates, px²."""
    return 0.25 * float(left.cov_px[0, 0] + left.cov_px[1, 1] + right.cov_px[0, 0] + right.cov_px[1, 1])


def shift_cov(previous: Observation3D | None, observation: Observation3D) -> Array:
    """Covariance (3, 3) m² of the shift of the observed centre on the object since the previous observation; 0 without
    one.

    Where the outline shows more or less of the object, the centre moves about as far as the radius changes: a part at
    the rim with a small share ε of the area changes the radius by ε/2 of itself and moves the centre by ε of it, 2/√3
    as much per axis.  Changes within the radius's variance are noise.  Where the correlated error grows, as when
    something comes before the object, the centre moves by as much as its standard deviations grow.
    """
    if previous is None:
        return np.zeros((3, 3))
    change_m = observation.radius_m - previous.radius_m
    of_outline = max(change_m**2 - previous.radius_var_m2 - observation.radius_var_m2, 0.0)
    growth_m, axes = np.linalg.eigh(_root(observation.correlated_cov_root) - _root(previous.correlated_cov_root))
    cov: Array = of_outline * np.eye(3) + axes * np.maximum(growth_m, 0.0) ** 2 @ axes.T
    return cov


def _root(cov: Array) -> Array:
    """Square root (3, 3) of a covariance."""
    variances, axes = np.linalg.eigh(cov)
    root: Array = axes * np.sqrt(np.maximum(variances, 0.0)) @ axes.T
    return root


def with_pose_error(
    observation: Observation3D, previous: StereoView, view: StereoView, dt_s: float, stamp_error_s: float
) -> Observation3D:
    """Return the observation with the error that stale joints add to its covariance.

    While the head turns, joints that are off by `stamp_error_s` (a standard deviation) shift a resting object by its
    apparent velocity times that.  It changes from image to image as the head's velocity does.
    """
    off_m = stamp_error_s * apparent_velocity(previous, view, observation.p_root, dt_s)
    pose_cov = np.outer(off_m, off_m)
    correlated = observation.correlated_cov_root + _STEADY * pose_cov
    return replace(observation, cov_root=observation.cov_root + pose_cov, correlated_cov_root=correlated)


def with_velocity_error(
    observation: Observation3D, view: StereoView, late_s: tuple[float, float], velocity_cov: Array
) -> Observation3D:
    """Return the observation of a moving object with the error of its velocity, if its outlines were seen `late_s`
    (left, right) after the observation's stamp and moved there by its predicted velocity, which has a covariance
    (3, 3) m²/s²."""
    J_left, J_right = (eye.project_jacobian(observation.p_root) for eye in (view.left, view.right))
    J = np.concatenate([J_left, J_right])
    moved = np.concatenate([late_s[0] * J_left, late_s[1] * J_right])
    D = np.linalg.solve(J.T @ J, J.T @ moved)  # ∂position / ∂velocity
    return replace(observation, cov_root=observation.cov_root + D @ velocity_cov @ D.T)


def apparent_velocity(previous: StereoView, view: StereoView, p_root: Array, dt_s: float) -> Array:
    """(3,) m/s in the root frame of a point that rests in both images, now at `p_root` (3,), while the head turns and
    the eyes converge from the previous view to this one."""
    place = np.array((*p_root, 1.0))
    jacobians = []
    drifts = []
    for old_eye, eye in ((previous.left, view.left), (previous.right, view.right)):
        jacobian = eye.project_jacobian(p_root)
        jacobians.append(jacobian)
        drifts.append(jacobian @ (place - old_eye.T_root_camera @ (eye.T_camera_root @ place))[:3])
    J = np.concatenate(jacobians)
    velocity: Array = np.linalg.solve(J.T @ J, J.T @ np.concatenate(drifts)) / dt_s
    return velocity
