"""Which sighting in the left eye belongs to which in the right, and where the object then is."""

import math
from dataclasses import dataclass

import numpy as np

from pps_vision.geometry.camera import StereoView
from pps_vision.geometry.triangulation import triangulate
from pps_vision.types import Array, Observation3D
from tracking.outline import Outline


@dataclass(frozen=True)
class AssociationParams:
    """`unknown_error` is what the calibration may be off before anything is known of it, as a share
    of the image's width; the gate opens to `gate_sigma` of that, narrowing over `gate_memory` pairs
    to the residual measured; `memory` pairs tell the error that widens the covariance, never less
    than `min_error_px`, and after `any_pairs` only those that show a whole ball; `max_ratio` between the
    two eyes' apparent radii; distances outside `distance_range`, in baselines (whatever the unit), are no
    object; `radius_error` is how far (relative) what is no ball may be from the sphere that its outline is
    taken for; an eye whose radius is `hidden_sigma` below the other's is taken to see only a part."""

    unknown_error: float = 0.008
    min_error_px: float = 0.005
    gate_sigma: float = 3.5
    gate_memory: float = 15.0
    memory: float = 20.0
    any_pairs: float = 10.0
    max_ratio: float = 1.7
    distance_range: tuple[float, float] = (0.7, 300.0)
    radius_error: float = 0.05
    hidden_sigma: float = 3.0


class Association:
    """Triangulates pairs, and learns from their residuals how far the calibration can be trusted."""

    def __init__(self, params: AssociationParams, width: int) -> None:
        self.params = params
        self._unknown_var = (params.unknown_error * width) ** 2
        self.forget()

    def forget(self) -> None:
        """Back to knowing nothing about the calibration's error."""
        self._gate_var, self._error_var, self._pairs = self._unknown_var, self._unknown_var, 0.0

    @property
    def error_px(self) -> float:
        """Standard deviation of what the calibration adds to each image coordinate."""
        return max(math.sqrt(max(self._error_var, 0.0)), self.params.min_error_px)

    def observe(
        self,
        view: StereoView,
        left: Outline,
        right: Outline,
        stamp_s: float,
        shift_px: tuple[Array, Array] | None = None,
    ) -> Observation3D | None:
        """The point both outlines are images of; None where there is none.

        `shift_px` moves each centre from its own stamp to the pair's, for eyes that do not look at once.
        """
        p = self.params
        ratio = left.angular_radius_rad / right.angular_radius_rad
        if max(ratio, 1 / ratio) > p.max_ratio:
            return None
        left_px, right_px = left.center_px, right.center_px
        if shift_px is not None:
            left_px, right_px = left_px + shift_px[0], right_px + shift_px[1]
        found = triangulate(view, left_px, right_px, left.cov_px, right.cov_px, self.error_px**2)
        if found is not None and any(hidden := self._hidden_px2(view, left, right, found.p_root)):
            cov_left, cov_right = left.cov_px + hidden[0] * np.eye(2), right.cov_px + hidden[1] * np.eye(2)
            found = triangulate(view, left_px, right_px, cov_left, cov_right, self.error_px**2)
        if found is None or 4 * found.residual_px**2 > p.gate_sigma**2 * (_own_var(left, right) + self._gate_var):
            return None
        eye = view.left.center.tolist()
        baseline, distance = math.dist(view.right.center.tolist(), eye), math.dist(found.p_root.tolist(), eye)
        if not p.distance_range[0] * baseline <= distance <= p.distance_range[1] * baseline:
            return None
        radius, radius_var = self._radius(view, left, right, found.p_root, found.cov_root)
        return Observation3D(stamp_s, found.p_root, found.cov_root, radius, radius_var, found.residual_px)

    def learn(self, observation: Observation3D, left: Outline, right: Outline) -> None:
        """Take an accepted pair's residual in.  Four coordinates leave one degree of freedom, so
        4·residual² estimates the variance of one coordinate; few such say little, hence 1 + 3/n.  Residuals that
        are by chance smaller than the outlines' own noise must count too, or that noise would be counted twice; but
        what is hidden differently from either eye says nothing of the calibration."""
        excess = 4 * observation.residual_px**2 - _own_var(left, right)
        self._gate_var += (max(excess, 0.0) - self._gate_var) / self.params.gate_memory
        if self._pairs >= self.params.any_pairs and max(left.oddness, right.oddness) >= 0.5:
            return
        mean = self._error_var / (1 + 3 / self._pairs) if self._pairs else 0.0
        self._pairs = min(self._pairs + 1, self.params.memory)
        self._error_var = (mean + (excess - mean) / self._pairs) * (1 + 3 / self._pairs)

    def _hidden_px2(self, view: StereoView, left: Outline, right: Outline, p: Array) -> tuple[float, float]:
        """Variance of a centre whose eye sees the thing surely smaller than the other does: what hides a strip of
        a disc moves its centre by as much as it takes from its radius."""
        radii, variances, scales = [], [], []
        for one, eye in ((left, view.left), (right, view.right)):
            distance, sine = math.dist(p.tolist(), eye.center.tolist()), math.sin(one.angular_radius_rad)
            radii.append(distance * sine)
            variances.append(
                distance**2 * one.angular_radius_var + (self.params.radius_error * one.oddness * radii[-1]) ** 2
            )
            scales.append(eye.camera.focal_px / distance)
        gap = radii[0] - radii[1]
        if gap * gap <= self.params.hidden_sigma**2 * sum(variances):
            return 0.0, 0.0
        return (0.0, (gap * scales[1]) ** 2) if gap > 0 else ((gap * scales[0]) ** 2, 0.0)

    def _radius(self, view: StereoView, left: Outline, right: Outline, p: Array, cov: Array) -> tuple[float, float]:
        """Radius (m) and variance (m²) from both apparent radii at the triangulated distance."""
        total, most, sum_of_weights = 0.0, 0.0, 0.0
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = cov.tolist()
        for one, eye in ((left, view.left), (right, view.right)):
            x, y, z = (p - eye.center).tolist()
            distance2 = x * x + y * y + z * z
            along = x * x * xx + y * y * yy + z * z * zz + 2 * (x * y * xy + x * z * xz + y * z * yz)
            sine = math.sin(one.angular_radius_rad)
            radius = math.sqrt(distance2) * sine
            var = distance2 * (1 - sine**2) * one.angular_radius_var + sine**2 * along / distance2
            weight = 1 / (var + (self.params.radius_error * one.oddness * radius) ** 2)
            total, most, sum_of_weights = total + weight * radius, max(most, weight), sum_of_weights + weight
        return total / sum_of_weights, 1 / most


def _own_var(left: Outline, right: Outline) -> float:
    """Mean variance of the four coordinates, px²."""
    ((a, _), (_, b)), ((c, _), (_, d)) = left.cov_px.tolist(), right.cov_px.tolist()
    return 0.25 * float(a + b + c + d)
