"""Which sighting in the left eye belongs to which in the right, and where the object then is."""

from dataclasses import dataclass

import numpy as np

from pps_vision.geometry.camera import StereoView, View
from pps_vision.geometry.triangulation import triangulate
from pps_vision.types import Array, Observation3D
from tracking.outline import Outline


@dataclass(frozen=True)
class AssociationParams:
    """`unknown_error` is what the calibration may be off before anything is known of it, as a share
    of the image's width; the gate opens to `gate_sigma` of that, narrowing over `gate_memory` pairs
    to the residual measured; `memory` pairs tell the error that widens the covariance, never less
    than `min_error_px`; `max_ratio` between the two eyes' apparent radii; distances outside
    `distance_range`, in baselines (whatever the unit), are no object; `radius_error` is how far
    (relative) an outline may be from a sphere's."""

    unknown_error: float = 0.008
    min_error_px: float = 0.015
    gate_sigma: float = 3.5
    gate_memory: float = 15.0
    memory: float = 20.0
    max_ratio: float = 1.7
    distance_range: tuple[float, float] = (0.7, 300.0)
    radius_error: float = 0.05


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
        return max(float(np.sqrt(self._error_var)), self.params.min_error_px)

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
        extra = self.error_px**2 * np.eye(2)
        shift_left, shift_right = shift_px or (np.zeros(2), np.zeros(2))
        left_px, right_px = left.center_px + shift_left, right.center_px + shift_right
        found = triangulate(view, left_px, right_px, left.cov_px + extra, right.cov_px + extra)
        if found is None or 4 * found.residual_px**2 > p.gate_sigma**2 * (_own_var(left, right) + self._gate_var):
            return None
        baseline = np.linalg.norm(view.right.center - view.left.center)
        distance = np.linalg.norm(found.p_root - view.left.center)
        if not p.distance_range[0] * baseline <= distance <= p.distance_range[1] * baseline:
            return None
        radius, radius_var = self._radius(view, left, right, found.p_root, found.cov_root)
        return Observation3D(stamp_s, found.p_root, found.cov_root, radius, radius_var, found.residual_px)

    def learn(self, observation: Observation3D, left: Outline, right: Outline) -> None:
        """Take an accepted pair's residual in.  Four coordinates leave one degree of freedom, so
        4·residual² estimates the variance of one coordinate; few such say little, hence 1 + 3/n."""
        excess = max(4 * observation.residual_px**2 - _own_var(left, right), 0.0)
        mean = self._error_var / (1 + 3 / self._pairs) if self._pairs else 0.0
        self._pairs = min(self._pairs + 1, self.params.memory)
        self._error_var = (mean + (excess - mean) / self._pairs) * (1 + 3 / self._pairs)
        self._gate_var += (excess - self._gate_var) / self.params.gate_memory

    def _radius(self, view: StereoView, left: Outline, right: Outline, p: Array, cov: Array) -> tuple[float, float]:
        """Radius (m) and variance (m²) from both apparent radii at the triangulated distance."""
        values, weights = [], []
        for one, eye in ((left, view.left), (right, view.right)):
            distance, distance_var = _distance(eye, p, cov)
            theta = one.angular_radius_rad
            radius = distance * np.sin(theta)
            var = distance**2 * np.cos(theta) ** 2 * one.angular_radius_var + np.sin(theta) ** 2 * distance_var
            values.append(radius)
            weights.append(1 / (var + (self.params.radius_error * radius) ** 2))
        return float(np.average(values, weights=weights)), float(1 / max(weights))


def _own_var(left: Outline, right: Outline) -> float:
    """Mean variance of the four coordinates, px²."""
    return 0.25 * float(np.trace(left.cov_px) + np.trace(right.cov_px))


def _distance(eye: View, p: Array, cov: Array) -> tuple[float, float]:
    """Distance from an eye (m) and its variance (m²)."""
    line = p - eye.center
    distance = float(np.linalg.norm(line))
    line = line / distance
    return distance, float(line @ cov @ line)
