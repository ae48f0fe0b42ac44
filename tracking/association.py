"""Which sighting in the left eye belongs to which in the right, and where the object then is."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from pps_vision.geometry.camera import StereoView
from pps_vision.geometry.triangulation import Triangulation, triangulate
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
        if found is None:
            return None
        size = self._size(view, left, right, found)
        if size.gap**2 > p.hidden_sigma**2 * size.gap_var:
            hidden = self._hidden_px2(view, size)
            cov_left, cov_right = left.cov_px + hidden[0] * np.eye(2), right.cov_px + hidden[1] * np.eye(2)
            found = triangulate(view, left_px, right_px, cov_left, cov_right, self.error_px**2)
            if found is None:
                return None
            size = self._size(view, left, right, found)
        if 4 * found.residual_px**2 > p.gate_sigma**2 * (_own_var(left, right) + self._gate_var):
            return None
        baseline = math.dist(view.right.place, view.left.place)
        if not p.distance_range[0] * baseline <= size.from_left <= p.distance_range[1] * baseline:
            return None
        return Observation3D(stamp_s, found.p_root, found.cov_root, size.radius, size.radius_var, found.residual_px)

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

    def _size(self, view: StereoView, left: Outline, right: Outline, found: Triangulation) -> "_Size":
        """The size of what both see there."""
        odd_left, odd_right = self.params.radius_error * left.oddness, self.params.radius_error * right.oddness
        return _Size(
            *_sizes(
                *(found.p_root, found.cov_root),
                (*view.left.place, left.angular_radius_rad, left.angular_radius_var, odd_left),
                (*view.right.place, right.angular_radius_rad, right.angular_radius_var, odd_right),
            )
        )

    def _hidden_px2(self, view: StereoView, size: "_Size") -> tuple[float, float]:
        """Variance of a centre whose eye sees the thing smaller than the other does: what hides a strip of a disc
        moves its centre by as much as it takes from its radius."""
        if size.gap > 0:
            return 0.0, (size.gap * view.right.camera.focal_px / size.from_right) ** 2
        return (size.gap * view.left.camera.focal_px / size.from_left) ** 2, 0.0


class _Size(NamedTuple):
    """Radius (m) and its variance; by how much the left eye sees it larger than the right, and the variance of that
    were the distance known; distances from either eye."""

    radius: float
    radius_var: float
    gap: float
    gap_var: float
    from_left: float
    from_right: float


Seen = tuple[float, float, float, float, float, float]
"""Where an eye is, the angular radius (rad) it sees and its variance, and the radius's relative error by shape."""


@njit(cache=True, error_model="numpy")
def _sizes(p: Array, cov: Array, left: Seen, right: Seen) -> tuple[float, float, float, float, float, float]:
    """The numbers of a `_Size` at p (3,) with cov (3, 3)."""
    total = most = sum_of_weights = gap = gap_var = 0.0
    far = (0.0, 0.0)
    for sign, eye in ((1.0, left), (-1.0, right)):
        u, v, w, angle, angle_var, odd = eye
        x, y, z = p[0] - u, p[1] - v, p[2] - w
        far2, sine = x * x + y * y + z * z, math.sin(angle)
        radius = math.sqrt(far2) * sine
        along = x * x * cov[0, 0] + y * y * cov[1, 1] + z * z * cov[2, 2]
        along += 2 * (x * y * cov[0, 1] + x * z * cov[0, 2] + y * z * cov[1, 2])
        odd_var = (odd * radius) ** 2
        weight = 1 / (far2 * (1 - sine**2) * angle_var + sine**2 * along / far2 + odd_var)
        total, most, sum_of_weights = total + weight * radius, max(most, weight), sum_of_weights + weight
        gap, gap_var, far = gap + sign * radius, gap_var + far2 * angle_var + odd_var, (far[1], math.sqrt(far2))
    return total / sum_of_weights, 1 / most, gap, gap_var, far[0], far[1]


def _own_var(left: Outline, right: Outline) -> float:
    """Mean variance of the four coordinates, px²."""
    ((a, _), (_, b)), ((c, _), (_, d)) = left.cov_px.tolist(), right.cov_px.tolist()
    return 0.25 * float(a + b + c + d)
